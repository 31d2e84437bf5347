// XML of URDF: well-formed and malformed text, other kinds of files, xacro, numbers in any locale,
// and huge sizes.

#include "clothctl/bridge/detail/urdf_xml.hpp"

#include <clocale>
#include <string>

#include "bridge/urdf_text.hpp"
#include "clothctl/bridge/urdf.hpp"
#include "io/spoilt_text.hpp"
#include "support/catch.hpp"
#include "support/reading.hpp"

using namespace clothctl;
using namespace clothctl;
using namespace clothctl_test;

namespace {

std::string refusal(const std::string& text) { return refusal_of(parse_urdf(text, "f.urdf")); }

std::string repeated(const std::string& text, int count) {
  std::string out;
  for (int k = 0; k < count; ++k) out += text;
  return out;
}

}  // namespace

TEST_CASE("URDF: all forms of XML are read", "[urdf]") {
  const std::string link = "<link name='a'/>";
  CHECK(refusal("<robot name=\"r\">" + link + "</robot>") == "accepted");
  CHECK(refusal("\xef\xbb\xbf<?xml version=\"1.0\"?>\r\n<!-- a -->\r\n<robot name='r'>\r\n" + link +
                "</robot>\r\n<!-- b -->\r\n") == "accepted");
  CHECK(refusal("\n\n<!DOCTYPE robot><robot name='r'>text" + link +
                "<![CDATA[ <link/> ]]></robot>\n") == "accepted");
  const UrdfModel<double> model = value_of(
      parse_urdf("<robot name='&lt;r&amp;&#x41;&gt;'><link name=\"a&quot;b\"/></robot>", "f.urdf"));
  CHECK(model.name == "<r&A>");
  CHECK(model.tree.find_link("a\"b") == 0);
  CHECK(refusal("<robot name='r'><link name='a'/><link name='b&#10;c'/></robot>") ==
        "f.urdf:1: link \"b?c\": no joint moves it, and none moves link \"a\" in line 1: a robot "
        "has one root");
}

TEST_CASE("URDF: XML that is not well formed is refused with its line", "[urdf]") {
  CHECK(refusal("") == "f.urdf:1: the file is empty");
  CHECK(refusal(" \n\t\r\n") == "f.urdf:1: the file is empty");
  CHECK(refusal("\xef\xbb\xbf") == "f.urdf:1: the file is empty");
  CHECK(refusal("<robot name='r'>\n<link name='a'>\n</robot>\n") ==
        "f.urdf:2: the file is not XML: an element is not closed by its own tag, in <link>");
  CHECK(refusal("<robot name='r'>\n<link name='a'/>\n") ==
        "f.urdf:1: the file is not XML: it ends within an element");
  CHECK(refusal("<robot name='r'>\n<link name=a/>\n</robot>\n") ==
        "f.urdf:2: the file is not XML: an attribute is broken or there twice, in <link>");
  CHECK(refusal("<robot name='r'>\n<link name='a' name='b'/>\n</robot>\n") ==
        "f.urdf:2: the file is not XML: an attribute is broken or there twice, in <link>");
  CHECK(refusal("<robot>\n<!-- never ends\n</robot>")
            .rfind("f.urdf:2: the file is not XML: a comment does not end", 0) == 0);
  CHECK(refusal("<!-- nothing -->\n") == "f.urdf:1: the file holds no element, expected <robot>");
  CHECK(refusal(robot_text(link_text("a")) + "<robot/>") ==
        "f.urdf:4: something follows </robot>, expected the end of the file");
  CHECK(refusal(robot_text(link_text("a")) + "more") ==
        "f.urdf:4: the file is not XML: text does not end");
  CHECK(refusal(robot_text(link_text("a")) + "more<!-- -->") ==
        "f.urdf:4: something follows </robot>, expected the end of the file");
  for_each_prefix(full_robot(),
                  [](const std::string& text) { check_refusal(refusal(text), "f.urdf", text); });
}

TEST_CASE("URDF: files of other kinds are recognised", "[urdf]") {
  CHECK(refusal("<?xml version=\"1.0\"?>\n<sdf version=\"1.6\"/>\n") ==
        "f.urdf:2: <sdf> found, expected <robot>: the file is not URDF");
  CHECK(refusal("<mujoco model=\"x\"/>") ==
        "f.urdf:1: <mujoco> found, expected <robot>: the file is not URDF");
  CHECK(refusal("\n{\"a\": 1}") == "f.urdf:2: the file is not XML: it begins with \"{\"a\": 1}\"");
  CHECK(refusal("solid part\n") == "f.urdf:1: the file is not XML: it begins with \"solid part\"");
  CHECK(refusal(std::string("\x7f"
                            "ELF\0\0",
                            6))
            .rfind("f.urdf:1: the file is not XML: it begins with", 0) == 0);
  CHECK(refusal(std::string("<\0r\0o\0", 6)) ==
        "f.urdf:1: the file is not text in UTF-8: it holds a zero byte");
  CHECK(refusal(robot_text(link_text("a")) + std::string(1, '\0')) ==
        "f.urdf:4: the file is not text in UTF-8: it holds a zero byte");
}

TEST_CASE("URDF: xacro is recognised", "[urdf]") {
  const std::string head = "<robot name=\"r\" xmlns:xacro=\"http://www.ros.org/wiki/xacro\">\n";
  CHECK(refusal(head + link_text("a") + "</robot>") ==
        "accepted");  // left over after running xacro
  CHECK(refusal(head + "<xacro:include filename=\"x\"/>\n</robot>") ==
        "f.urdf:2: <xacro:include> belongs to xacro: run xacro on the file first");
  CHECK(refusal(head + "<link name=\"a\">\n<visual><xacro:box/></visual></link></robot>") ==
        "f.urdf:3: <xacro:box> belongs to xacro: run xacro on the file first");
  CHECK(refusal(head + link_text("${side}_a") + "</robot>") ==
        "f.urdf:2: <link> name: \"${side}_a\" is an expression of xacro: run xacro on the file "
        "first");
  CHECK(refusal(pair_text("fixed", "<origin xyz=\"$(arg x) 0 0\"/>")) ==
        "f.urdf:7: joint \"j\": <origin> xyz: \"$(arg x) 0 0\" is an expression of xacro: run "
        "xacro on the file first");
}

TEST_CASE("URDF: numbers are read the same in every locale", "[urdf]") {
  const auto place = [](const std::string& xyz) {
    const UrdfModel<double> model =
        value_of(parse_urdf(pair_text("floating", "<origin xyz=\"" + xyz + "\"/>"), "f.urdf"));
    return model.tree.bodies().front().placement.p;
  };
  const Vector3<double> expected(0.5, -1250, 3);
  const std::string before = std::setlocale(LC_ALL, nullptr);
  for (const char* locale : {"C", "de_DE.UTF-8", "de_DE", "fr_FR.UTF-8"}) {
    if (std::setlocale(LC_ALL, locale) == nullptr) continue;
    CHECK(place("0.5 -1.25e3 +3") == expected);
    CHECK(place("\n  .5\t-1250.\r\n 3.0e+0  ") == expected);
  }
  std::setlocale(LC_ALL, before.c_str());
  for (const std::string bad : {"0x1p3 0 0", "1e 0 0", "+-1 0 0", "++1 0 0", "1_000 0 0", "1d0 0 0",
                                "- 0 0", "& 0 0", "1;2;3"})
    CHECK(refusal(pair_text("fixed", "<origin xyz=\"" + bad + "\"/>")).find("is not a number") !=
          std::string::npos);
}

TEST_CASE("URDF: huge sizes are refused with a message", "[urdf]") {
  CHECK(refusal(repeated("<robot>", 100000))
            .rfind("f.urdf:1: the file is not XML: elements are nested too deep", 0) == 0);
  CHECK(refusal(robot_text(link_text("a", repeated("<b>", 90) + repeated("</b>", 90)))) ==
        "accepted");
  CHECK(refusal(robot_text(link_text("a") + std::string(detail::kLargestUrdf, ' '))) ==
        "f.urdf:1: the file is larger than 16 MiB");
  const std::string text =
      robot_text(link_text(std::string(100000, 'x')) + link_text(repeated("ü", 1000)));
  check_refusal(refusal(text), "f.urdf", text);
  CHECK(refusal(text).find("\"" + repeated("ü", 20) + "…\"") != std::string::npos);
  // A chain of joints where each follows the previous one, and equally many joints on one link.
  std::string chain = link_text("l0", inertial_text()), star = chain;
  for (int k = 1; k < 3000; ++k) {
    const std::string own = std::to_string(k), before = std::to_string(k - 1);
    chain += link_text("l" + own, inertial_text()) +
             joint_text("j" + own, "continuous", "l" + before, "l" + own,
                        k > 1 ? "<mimic joint=\"j" + before + "\" multiplier=\"-1\"/>" : "");
    star += link_text("l" + own, inertial_text()) +
            joint_text("j" + own, "continuous", "l0", "l" + own);
  }
  CHECK(value_of(parse_urdf(robot_text(chain), "f.urdf")).tree.nv() == 1);
  CHECK(value_of(parse_urdf(robot_text(star), "f.urdf")).tree.nv() == 2999);
}
