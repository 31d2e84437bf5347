// The values of a JSON text, one by one, and the first error of each kind.

#include "clothctl/bridge/detail/json_reader.hpp"

#include <string>
#include <vector>

#include "clothctl/robot/kinematic_tree_builder.hpp"
#include "support/catch.hpp"

using namespace clothctl;

namespace {

using Vec = Vector3<double>;
using detail::Json;

KinematicTree<double> robot() {
  KinematicTreeBuilder<double> builder;
  builder.add_link("palm").add_link("bone");
  Joint<double> joint;
  joint.name = "bend", joint.parent = "palm", joint.child = "bone";
  return builder.add_joint(joint).build().value();
}

/// Opens what the reader offers to those that derive from it.
struct Reader : detail::JsonReader<double> {
  using Base = detail::JsonReader<double>;
  using Base::Base, Base::load, Base::root, Base::find, Base::word, Base::number, Base::point,
      Base::link, Base::for_each, Base::is_list, Base::fail;
};

/// Loads a text and returns the error.
std::string refusal(const std::string& text) {
  const auto tree = robot();
  Reader reader(tree, "f.json");
  CHECK_FALSE(reader.load(text));
  return reader.error();
}

/// Loads a text, reads with `read(reader)`, and returns the error.
template <class Read>
std::string error_of(const std::string& text, const Read& read) {
  const auto tree = robot();
  Reader reader(tree, "f.json");
  REQUIRE(reader.load(text));
  CHECK_FALSE(read(reader));
  return reader.error();
}

}  // namespace

TEST_CASE("values are read as they stand", "[bridge]") {
  const auto tree = robot();
  Reader reader(tree, "f.json");
  REQUIRE(reader.load(
      R"({"name": "left", "n": -3, "x": 0.5, "at": [1, -2.5, 3e-3], "on": "bone", "list": [4, 5]})"));
  std::string name;
  CHECK(reader.word(reader.root(), "", "name", name));
  CHECK(name == "left");
  double number = 0;
  CHECK(reader.number(*reader.find(reader.root(), "", "n", true), "n", number));
  CHECK(number == -3);
  CHECK(reader.number(*reader.find(reader.root(), "", "x", true), "x", number));
  CHECK(number == 0.5);
  Vec place;
  CHECK(reader.point(reader.root(), "", "at", place));
  CHECK(place == Vec(1, -2.5, 3e-3));
  int link = -1;
  CHECK(reader.link(reader.root(), "", "on", link));
  CHECK(link == tree.find_link("bone"));
  std::vector<std::string> paths;
  CHECK(reader.for_each("list", true, [&](const Json&, const std::string& where) {
    paths.push_back(where);
    return true;
  }));
  CHECK(paths == std::vector<std::string>{"list[0]", "list[1]"});
  CHECK(reader.for_each("none", false, [](const Json&, const std::string&) { return false; }));
  CHECK(reader.find(reader.root(), "", "none", false) == nullptr);
  CHECK(reader.error().empty());
}

TEST_CASE("a text that is no sound JSON object is refused", "[bridge]") {
  CHECK(refusal("").find("f.json") == 0);
  CHECK(refusal("{\"a\": 1,\n\n oops}").find("f.json:3: the file is not JSON: ") == 0);
  CHECK(refusal("[1]") == "f.json: a list of 1 found, must be an object");
  CHECK(refusal("7") == "f.json: 7 found, must be an object");
  CHECK(refusal(R"({"a": 1, "a": 2})") == "f.json: the key \"a\" occurs twice in one object");
  const std::string deep = "{\"a\": " + std::string(40, '[') + std::string(40, ']') + "}";
  CHECK(refusal(deep) == "f.json: lists and objects are nested too deep");
  CHECK(refusal(std::string(detail::kLargestJson + 1, ' ')) ==
        "f.json: the file is larger than 4 MiB");
  // Deep, but not too deep; and one key in two objects.
  const auto tree = robot();
  Reader reader(tree, "f.json");
  CHECK(reader.load("{\"a\": " + std::string(30, '[') + std::string(30, ']') + "}"));
  CHECK(reader.load(R"({"a": {"b": 1}, "c": {"b": 2}})"));
}

TEST_CASE("a value of another kind is named with its path", "[bridge]") {
  std::string text;
  double number = 0;
  Vec place;
  int link = 0;
  const auto word = [&](Reader& r) { return r.word(r.root(), "", "k", text); };
  CHECK(error_of("{}", word) == "f.json: there is no \"k\"");
  CHECK(error_of(R"({"k": 1})", word) == "f.json: k: is 1, must be a name");
  CHECK(error_of(R"({"k": ""})", word) == "f.json: k: is \"\", must be a name");
  const auto value = [&](Reader& r) {
    return r.number(*r.find(r.root(), "", "k", true), "k", number);
  };
  CHECK(error_of(R"({"k": true})", value) == "f.json: k: is true, must be a number");
  CHECK(error_of(R"({"k": -2e6})", value) == "f.json: k: is -2000000.0, must be from -1e6 to 1e6");
  const auto point = [&](Reader& r) { return r.point(r.root(), "", "k", place); };
  CHECK(error_of(R"({"k": [1, 2]})", point) ==
        "f.json: k: is a list of 2, must be a list of 3 numbers");
  CHECK(error_of(R"({"k": [1, 2, null]})", point) == "f.json: k[2]: is null, must be a number");
  const auto on = [&](Reader& r) { return r.link(r.root(), "", "k", link); };
  CHECK(error_of(R"({"k": {}})", on) == "f.json: k: is an object, must be the name of a link");
  CHECK(error_of(R"({"k": "toe"})", on) == "f.json: k: the robot has no link \"toe\"");
  const auto each = [&](Reader& r) {
    return r.for_each("k", true, [&](const Json& item, const std::string& where) {
      return r.number(item, where, number);
    });
  };
  CHECK(error_of(R"({"k": 3})", each) == "f.json: k: is 3, must be a list");
  CHECK(error_of(R"({"k": [1, "b"]})", each) == "f.json: k[1]: is \"b\", must be a number");
}

TEST_CASE("the first error stays", "[bridge]") {
  const auto tree = robot();
  Reader reader(tree, "f.json");
  CHECK_FALSE(reader.fail("a", "is first"));
  CHECK_FALSE(reader.fail("b", "is second"));
  CHECK(reader.error() == "f.json: a: is first");
}
