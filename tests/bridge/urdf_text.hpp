#pragma once

// URDF texts for tests with known lines: a robot with all supported elements, and joints between
// one-line links.

#include <string>

namespace clothctl_test {

/// A link in one line, with `inside` as its content.
inline std::string link_text(const std::string& name, const std::string& inside = "") {
  return "<link name=\"" + name + "\">" + inside + "</link>\n";
}

/// An inertia of 2 kg.
inline std::string inertial_text(const std::string& origin = "") {
  return "<inertial>" + origin +
         "<mass value=\"2\"/><inertia ixx=\"0.01\" ixy=\"0\" ixz=\"0\" iyy=\"0.02\" iyz=\"0\" "
         "izz=\"0.015\"/></inertial>";
}

/// A joint of four lines: its head, parent, child, and the rest.
inline std::string joint_text(const std::string& name, const std::string& type,
                              const std::string& parent, const std::string& child,
                              const std::string& inside = "") {
  return "<joint name=\"" + name + "\" type=\"" + type + "\">\n<parent link=\"" + parent +
         "\"/>\n<child link=\"" + child + "\"/>\n" + inside + "</joint>\n";
}

/// A robot with contents from line 2 on.
inline std::string robot_text(const std::string& inside) {
  return "<robot name=\"r\">\n" + inside + "</robot>\n";
}

/// Links "a" (line 2) and "b" (line 3, 2 kg), joined by joint "j" (head in line 4) with `inside` in
/// line 7.
inline std::string pair_text(const std::string& type, const std::string& inside) {
  return robot_text(link_text("a") + link_text("b", inertial_text()) +
                    joint_text("j", type, "a", "b", inside));
}

/// A robot with every supported element.
inline std::string full_robot() {
  return R"(<?xml version="1.0" encoding="utf-8"?>
<!-- every element -->
<robot name="everything">
  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
  <link name="world"/>
  <joint name="lift" type="prismatic">
    <origin xyz="0.1 0.2 0.3" rpy="0.3 -0.2 0.1"/>
    <parent link="world"/>
    <child link="carriage"/>
    <axis xyz="0 0 2"/>
    <limit lower="-0.5" upper="1.5" effort="100" velocity="2"/>
    <dynamics damping="0.5" friction="0.25"/>
  </joint>
  <link name="carriage">
    <inertial>
      <origin xyz="0.01 -0.02 0.03" rpy="0.1 0.2 0.3"/>
      <mass value="3"/>
      <inertia ixx="0.02" ixy="0.001" ixz="-0.002" iyy="0.03" iyz="0.003" izz="0.025"/>
    </inertial>
    <visual><origin xyz="0 0 0"/><geometry><box size="1 1 1"/></geometry></visual>
    <collision><geometry><sphere radius="0.1"/></geometry></collision>
  </link>
  <joint name="mount" type="fixed">
    <origin xyz="0 0.1 0" rpy="0 0 1.5707963267948966"/>
    <parent link="carriage"/>
    <child link="plate"/>
  </joint>
  <link name="plate">
    <inertial>
      <origin xyz="0 0 0.05"/>
      <mass value="1"/>
      <inertia ixx="0.004" ixy="0" ixz="0" iyy="0.005" iyz="0" izz="0.006"/>
    </inertial>
  </link>
  <joint name="turn" type="continuous">
    <parent link="plate"/>
    <child link="wheel"/>
    <axis xyz="0 1 0"/>
    <limit effort="3" velocity="4"/>
  </joint>
  <link name="wheel">
    <inertial>
      <mass value="0.5"/>
      <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.001"/>
    </inertial>
  </link>
  <joint name="bend" type="revolute">
    <origin xyz="0.2 0 0"/>
    <parent link="plate"/>
    <child link="finger"/>
    <axis xyz="1 1 0"/>
    <limit lower="-1" upper="2" effort="5" velocity="6"/>
    <dynamics damping="0.1" friction="0.02"/>
  </joint>
  <link name="finger">
    <inertial>
      <origin xyz="0.05 0 0"/>
      <mass value="0.2"/>
      <inertia ixx="0.0001" ixy="0" ixz="0" iyy="0.0002" iyz="0" izz="0.0002"/>
    </inertial>
  </link>
  <joint name="curl" type="revolute">
    <origin xyz="0.1 0 0"/>
    <parent link="finger"/>
    <child link="tip"/>
    <axis xyz="1 1 0"/>
    <limit lower="-1" upper="1" effort="5" velocity="6"/>
    <mimic joint="bend" multiplier="-0.5" offset="0.1"/>
    <dynamics damping="0.4" friction="0.04"/>
  </joint>
  <link name="tip">
    <inertial>
      <mass value="0.1"/>
      <inertia ixx="0.0001" ixy="0" ixz="0" iyy="0.0001" iyz="0" izz="0.0001"/>
    </inertial>
  </link>
  <joint name="fly" type="floating">
    <parent link="world"/>
    <child link="drone"/>
  </joint>
  <link name="drone">
    <inertial>
      <mass value="1.5"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.02"/>
    </inertial>
  </link>
  <link name="marker"/>
  <joint name="marked" type="fixed">
    <parent link="tip"/>
    <child link="marker"/>
  </joint>
  <gazebo reference="tip"/>
</robot>
)";
}

}  // namespace clothctl_test
