#pragma once

// Reads the values of a JSON text that describes a robot, and keeps the first error: one line with
// the file, the path to the value, as in `tips[2].contact_link`, and the value. Nothing throws.
// Needs nlohmann-json.

#include <algorithm>
#include <cstddef>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "clothctl/core/quoted_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/core/types.hpp"
#include "clothctl/robot/kinematic_tree.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Largest file, bytes, deepest nesting, and longest list. More is refused, so that a wrong file
/// fills neither memory nor time.
inline constexpr std::size_t kLargestJson = std::size_t(1) << 22;
inline constexpr std::size_t kDeepestJson = 32;
inline constexpr std::size_t kLongestList = 4096;

using Json = nlohmann::json;

/// Looks for what the parser keeps to itself: where a text is no JSON, keys that occur twice, and
/// deep nesting.
class JsonCheck : public nlohmann::json_sax<Json> {
 public:
  /// What is wrong, or empty, and how many bytes were read by then (0 if that is not known).
  std::string wrong;
  std::size_t place = 0;

  bool null() override { return true; }
  bool boolean(bool) override { return true; }
  bool number_integer(number_integer_t) override { return true; }
  bool number_unsigned(number_unsigned_t) override { return true; }
  bool number_float(number_float_t, const string_t&) override { return true; }
  bool string(string_t&) override { return true; }
  bool binary(binary_t&) override { return true; }
  bool start_object(std::size_t) override { return enter(); }
  bool start_array(std::size_t) override { return enter(); }
  bool end_object() override { return leave(); }
  bool end_array() override { return leave(); }
  bool key(string_t& name) override {
    if (keys_.back().insert(name).second) return true;
    wrong = "the key " + quoted_text(name) + " occurs twice in one object";
    return false;
  }
  bool parse_error(std::size_t position, const std::string&, const Json::exception& e) override {
    // The text is "[json.exception.… ] parse error at line …, column …: what".
    std::string_view what = e.what();
    if (const std::size_t end = what.find("] "); end != what.npos) what.remove_prefix(end + 2);
    if (what.substr(0, 11) == "parse error") {
      if (const std::size_t end = what.find(": "); end != what.npos) what.remove_prefix(end + 2);
    }
    wrong = "the file is not JSON: " + std::string(what.substr(0, 150));
    for (char& c : wrong) c = static_cast<unsigned char>(c) < 0x20 || c == 0x7f ? '?' : c;
    place = position;
    return false;
  }

 private:
  bool enter() {
    keys_.emplace_back();
    if (keys_.size() <= kDeepestJson) return true;
    wrong = "lists and objects are nested too deep";
    return false;
  }
  bool leave() {
    keys_.pop_back();
    return true;
  }

  std::vector<std::set<std::string>> keys_;
};

/// Reads values. Functions return true on success; `where` is the path to a value in the file.
template <RealScalar Scalar>
class JsonReader {
 public:
  JsonReader(const KinematicTree<Scalar>& tree, std::string file)
      : tree_(tree), file_(std::move(file)) {}

  /// The first error, or an empty text.
  const std::string& error() const { return error_; }

 protected:
  /// Neither a length (m) nor another number of a robot is larger.
  static constexpr double kLargest = 1e6;

  /// Parses a text whose outermost value is an object.
  bool load(std::string_view text);
  const KinematicTree<Scalar>& tree() const { return tree_; }
  const Json& root() const { return root_; }

  /// Returns a message about a value.
  std::string line(const std::string& where, const std::string& what) const {
    return file_ + ": " + where + (where.empty() ? "" : ": ") + what;
  }
  bool fail(const std::string& where, const std::string& what) {
    if (error_.empty()) error_ = line(where, what);
    return false;
  }
  /// Returns a value as an error shows it.
  static std::string shown(const Json& value) {
    if (const auto* text = value.get_ptr<const Json::string_t*>(); text != nullptr)
      return quoted_text(*text);
    if (value.is_array()) return "a list of " + std::to_string(value.size());
    if (value.is_object()) return "an object";
    return value.dump();  // a number, true, false or null
  }
  static std::string at(const std::string& where, const std::string& key) {
    return where.empty() ? key : where + '.' + key;
  }
  static std::string at(const std::string& where, std::size_t i) {
    return where + '[' + std::to_string(i) + ']';
  }

  /// Returns the value of a key, or null: with an error if it must be there.
  const Json* find(const Json& object, const std::string& where, const char* key, bool needed);
  bool is_list(const Json& value, const std::string& where);
  bool is_object(const Json& value, const std::string& where);
  bool word(const Json& object, const std::string& where, const char* key, std::string& out);
  bool number(const Json& value, const std::string& where, Scalar& out);
  bool point(const Json& object, const std::string& where, const char* key, Vector3<Scalar>& out);
  bool link(const Json& value, const std::string& where, int& out);
  bool link(const Json& object, const std::string& where, const char* key, int& out) {
    const Json* value = find(object, where, key, true);
    return value != nullptr && link(*value, at(where, key), out);
  }

  /// Calls `read(item, path)` for each item of the list with this key, until it returns false.
  template <class Read>
  bool for_each(const char* key, bool needed, const Read& read) {
    const Json* list = find(root_, "", key, needed);
    if (list == nullptr) return error_.empty();
    if (!is_list(*list, key)) return false;
    std::size_t i = 0;
    for (const Json& item : *list) {
      if (!read(item, at(std::string(key), i++))) return false;
    }
    return true;
  }

 private:
  const KinematicTree<Scalar>& tree_;
  std::string file_, error_;
  Json root_;
};

template <RealScalar Scalar>
bool JsonReader<Scalar>::load(std::string_view text) {
  if (kLargestJson < text.size())
    return fail("", "the file is larger than " + std::to_string(kLargestJson >> 20) + " MiB");
  JsonCheck check;
  if (!Json::sax_parse(text.begin(), text.end(), &check)) {
    if (check.place > 0) {
      const auto end =
          text.begin() + static_cast<std::ptrdiff_t>((std::min)(check.place, text.size()));
      file_ += ':' + std::to_string(1 + std::count(text.begin(), end, '\n'));
    }
    return fail("", check.wrong);
  }
  root_ = Json::parse(text.begin(), text.end(), nullptr, false);
  return root_.is_object() || fail("", shown(root_) + " found, must be an object");
}

template <RealScalar Scalar>
const Json* JsonReader<Scalar>::find(const Json& object, const std::string& where, const char* key,
                                     bool needed) {
  if (!is_object(object, where)) return nullptr;
  const auto found = object.find(key);
  if (found != object.end()) return &*found;
  if (needed) fail(where, std::string("there is no ") + quoted_text(key));
  return nullptr;
}

template <RealScalar Scalar>
bool JsonReader<Scalar>::is_object(const Json& value, const std::string& where) {
  return value.is_object() || fail(where, "is " + shown(value) + ", must be an object");
}

template <RealScalar Scalar>
bool JsonReader<Scalar>::is_list(const Json& value, const std::string& where) {
  if (!value.is_array()) return fail(where, "is " + shown(value) + ", must be a list");
  return value.size() <= kLongestList ||
         fail(where, "is " + shown(value) + ", must have at most " + std::to_string(kLongestList));
}

template <RealScalar Scalar>
bool JsonReader<Scalar>::word(const Json& object, const std::string& where, const char* key,
                              std::string& out) {
  const Json* value = find(object, where, key, true);
  if (value == nullptr) return false;
  const auto* text = value->get_ptr<const Json::string_t*>();
  if (text == nullptr || text->empty())
    return fail(at(where, key), "is " + shown(*value) + ", must be a name");
  out = *text;
  return true;
}

template <RealScalar Scalar>
bool JsonReader<Scalar>::number(const Json& value, const std::string& where, Scalar& out) {
  if (!value.is_number()) return fail(where, "is " + shown(value) + ", must be a number");
  double read = 0;
  if (const auto* real = value.get_ptr<const Json::number_float_t*>(); real != nullptr)
    read = *real;
  else if (const auto* whole = value.get_ptr<const Json::number_unsigned_t*>(); whole != nullptr)
    read = static_cast<double>(*whole);
  else if (const auto* negative = value.get_ptr<const Json::number_integer_t*>();
           negative != nullptr)
    read = static_cast<double>(*negative);
  if (!is_finite(read) || read < -kLargest || kLargest < read)
    return fail(where, "is " + shown(value) + ", must be from -1e6 to 1e6");
  out = Scalar(read);
  return true;
}

template <RealScalar Scalar>
bool JsonReader<Scalar>::point(const Json& object, const std::string& where, const char* key,
                               Vector3<Scalar>& out) {
  const Json* value = find(object, where, key, true);
  if (value == nullptr) return false;
  const std::string place = at(where, key);
  if (!value->is_array() || value->size() != 3)
    return fail(place, "is " + shown(*value) + ", must be a list of 3 numbers");
  Index i = 0;
  for (const Json& coordinate : *value) {
    if (!number(coordinate, at(place, static_cast<std::size_t>(i)), out[i])) return false;
    ++i;
  }
  return true;
}

template <RealScalar Scalar>
bool JsonReader<Scalar>::link(const Json& value, const std::string& where, int& out) {
  const auto* name = value.get_ptr<const Json::string_t*>();
  if (name == nullptr) return fail(where, "is " + shown(value) + ", must be the name of a link");
  out = tree_.find_link(*name);
  return 0 <= out || fail(where, "the robot has no link " + quoted_text(*name));
}

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
