#pragma once

// Reads XML as URDF uses it: elements whose attributes hold a name, or numbers separated by white
// space. The locale has no effect on numbers. Functions return true on success. The first error is
// kept as one line, `file:line: element: what is wrong`. Needs tinyxml2.

#include <algorithm>
#include <array>
#include <charconv>
#include <cstddef>
#include <initializer_list>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include <tinyxml2.h>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/types.hpp"

namespace clothctl::inline CLOTHCTL_ABI::detail {

/// Largest file, bytes. Larger files are refused, so that a wrong file does not fill the memory.
inline constexpr std::size_t kLargestUrdf = std::size_t(1) << 24;

/// Returns the first `most` bytes of a UTF-8 text, or a few fewer so that no character is cut.
inline std::string_view head_of(std::string_view text, std::size_t most) {
  if (text.size() <= most) return text;
  while (most > 0 && (static_cast<unsigned char>(text[most]) & 0xc0) == 0x80) --most;
  return text.substr(0, most);
}

/// Returns a text in quotes. Of a text longer than 40 bytes, it returns the start and `…`.
inline std::string quote(std::string_view text) {
  const std::string_view head = head_of(text, 40);
  return '"' + std::string(head) + (head.size() < text.size() ? "…\"" : "\"");
}

/// Returns a message as one line of bounded length. Control characters become `?`.
inline std::string one_line(const std::string& file, int line, std::string_view what) {
  const std::string_view head = head_of(what, 200);
  std::string out = file + ":" + std::to_string((std::max)(line, 1)) + ": " + std::string(head);
  if (head.size() < what.size()) out += "…";
  for (char& c : out) c = static_cast<unsigned char>(c) < 0x20 || c == 0x7f ? '?' : c;
  return out;
}

using XmlElement = tinyxml2::XMLElement;

/// Reads a document and keeps the first error.
class XmlReader {
 public:
  explicit XmlReader(std::string file) : file_(std::move(file)) {}

  /// Returns the first error, or an empty text.
  const std::string& error() const { return error_; }
  /// Warnings, one line each.
  std::vector<std::string> warnings;

 protected:
  /// Parses a document whose outermost element is <robot>.
  bool load(std::string_view text) {
    if (text.size() > kLargestUrdf)
      return fail(1, "the file is larger than " + std::to_string(kLargestUrdf >> 20) + " MiB");
    if (text.substr(0, 3) == "\xef\xbb\xbf") text.remove_prefix(3);
    const std::size_t first = text.find_first_not_of(" \t\r\n");
    if (first == std::string_view::npos) return fail(1, "the file is empty");
    const int line =
        1 + static_cast<int>(
                std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(first), '\n'));
    if (text[first] != '<')
      return fail(line, "the file is not XML: it begins with " +
                            quote(text.substr(first, text.find('\n', first) - first)));
    if (const std::size_t nul = text.find('\0'); nul != std::string_view::npos) {
      const auto end = text.begin() + static_cast<std::ptrdiff_t>(nul);
      return fail(1 + static_cast<int>(std::count(text.begin(), end, '\n')),
                  "the file is not text in UTF-8: it holds a zero byte");
    }
    if (document_.Parse(text.data(), text.size()) != tinyxml2::XML_SUCCESS)
      return fail(document_.ErrorLineNum(), fault());
    root_ = document_.RootElement();
    if (root_ == nullptr) return fail(1, "the file holds no element, expected <robot>");
    if (named(*root_, "robot")) return one_robot() && plain(*root_);
    return fail(root_->GetLineNum(),
                tag(*root_) + " found, expected <robot>: the file is not URDF");
  }

  /// Returns the element <robot>.
  const XmlElement& root() const { return *root_; }

  /// Stores the error unless one is stored already. Returns false.
  bool fail(int line, const std::string& what) {
    if (error_.empty()) error_ = one_line(file_, line, what);
    return false;
  }
  /// Like `fail`; the message also names the link or joint that is being read.
  bool fail_in(int line, const std::string& what) { return fail(line, owner_ + what); }
  void warn(int line, const std::string& what) { warnings.push_back(one_line(file_, line, what)); }

  /// Sets the link or joint that messages name from now on.
  void enter(const char* kind, const std::string& name) {
    owner_ = kind;
    owner_ += ' ';
    owner_ += quote(name);
    owner_ += ": ";
  }
  /// From now on, messages name no link or joint.
  void leave() { owner_.clear(); }
  const std::string& owner() const { return owner_; }

  static bool named(const XmlElement& element, std::string_view name) {
    return element.Name() == name;
  }
  static std::string tag(const XmlElement& element) {
    std::string text = "<";
    text += head_of(element.Name(), 40);
    text += '>';
    return text;
  }

  /// Sets `child` to the child element of that name, or to null if there is none. Two are an error.
  bool find(const XmlElement& parent, const char* name, const XmlElement*& child) {
    child = parent.FirstChildElement(name);
    const XmlElement* second = child == nullptr ? nullptr : child->NextSiblingElement(name);
    return second == nullptr || fail_in(second->GetLineNum(), tag(*second) + " occurs twice");
  }
  /// Like `find`, but a missing element is an error.
  bool need(const XmlElement& parent, const char* name, const XmlElement*& child) {
    if (!find(parent, name, child)) return false;
    return child != nullptr || fail_in(parent.GetLineNum(), tag(parent) + " has no <" + name + ">");
  }

  /// Reads an attribute that must exist and must not be empty.
  bool word(const XmlElement& element, const char* attribute, std::string& value) {
    const tinyxml2::XMLAttribute* found = element.FindAttribute(attribute);
    if (found == nullptr)
      return fail_in(element.GetLineNum(), tag(element) + " has no " + attribute);
    value = found->Value();
    if (value.empty()) return bad(*found, element, "is empty");
    return expanded(*found, element);
  }

  /// Reads an attribute that must exist and hold one finite number.
  template <RealScalar Scalar>
  bool number(const XmlElement& element, const char* attribute, Scalar& value) {
    std::array<Scalar, 1> values{Scalar(0)};
    if (!numbers(element, attribute, values)) return false;
    value = values[0];
    return true;
  }
  /// Reads an optional number. A missing attribute leaves the value unchanged.
  template <RealScalar Scalar>
  bool number_if_given(const XmlElement& element, const char* attribute, Scalar& value) {
    return element.FindAttribute(attribute) == nullptr || number(element, attribute, value);
  }
  template <RealScalar Scalar>
  bool triple(const XmlElement& element, const char* attribute, Vector3<Scalar>& value) {
    std::array<Scalar, 3> values{Scalar(0), Scalar(0), Scalar(0)};
    if (!numbers(element, attribute, values)) return false;
    value = Vector3<Scalar>(values[0], values[1], values[2]);
    return true;
  }
  template <RealScalar Scalar>
  bool triple_if_given(const XmlElement& element, const char* attribute, Vector3<Scalar>& value) {
    return element.FindAttribute(attribute) == nullptr || triple(element, attribute, value);
  }

  /// Warns of child elements that are not among the known ones.
  void warn_of_unknown(const XmlElement& parent, std::initializer_list<std::string_view> known) {
    for (const XmlElement* child = parent.FirstChildElement(); child != nullptr;
         child = child->NextSiblingElement()) {
      const std::string_view name = child->Name();
      if (std::find(known.begin(), known.end(), name) == known.end() &&
          name.find(':') == std::string_view::npos)
        warn(child->GetLineNum(), owner_ + tag(*child) + " is not read");
    }
  }

  /// Reports an error about an attribute, with its value.
  bool bad(const tinyxml2::XMLAttribute& attribute, const XmlElement& element,
           const std::string& what) {
    return fail_in(attribute.GetLineNum(), tag(element) + " " +
                                               std::string(head_of(attribute.Name(), 40)) + ": " +
                                               quote(attribute.Value()) + " " + what);
  }

 private:
  static constexpr std::string_view kBlank = " \t\r\n\v\f";

  template <RealScalar Scalar, std::size_t N>
  bool numbers(const XmlElement& element, const char* attribute, std::array<Scalar, N>& values) {
    std::string text;
    if (!word(element, attribute, text)) return false;
    const tinyxml2::XMLAttribute& found = *element.FindAttribute(attribute);
    std::size_t count = 0;
    for (std::string_view rest = text; true; ++count) {
      rest.remove_prefix((std::min)(rest.find_first_not_of(kBlank), rest.size()));
      if (rest.empty()) break;
      const std::string_view token = rest.substr(0, rest.find_first_of(kBlank));
      rest.remove_prefix(token.size());
      Scalar value(0);
      const std::string wrong = parse(token, value);
      if (!wrong.empty())
        return bad(found, element,
                   token == text ? wrong : "holds " + quote(token) + ", which " + wrong);
      if (count < N) values[count] = value;
    }
    if (count == N) return true;
    return bad(found, element,
               "holds " + std::to_string(count) + " numbers, expected " + std::to_string(N));
  }

  /// Parses a number. Returns an empty text on success, else what is wrong.
  template <RealScalar Scalar>
  static std::string parse(std::string_view token, Scalar& value) {
    if (token.size() > 1 && token[0] == '+' && token[1] != '-' && token[1] != '+')
      token.remove_prefix(1);
    double parsed = 0;
    const std::from_chars_result end =
        std::from_chars(token.data(), token.data() + token.size(), parsed);
    if (end.ec == std::errc::result_out_of_range) return "is out of range";
    if (end.ec != std::errc() || end.ptr != token.data() + token.size()) return "is not a number";
    if (!is_finite(parsed)) return "is not finite";
    value = Scalar(parsed);
    return is_finite(value) ? "" : "is out of range";
  }

  /// Refuses expressions that xacro should have replaced.
  bool expanded(const tinyxml2::XMLAttribute& attribute, const XmlElement& element) {
    const std::string_view value = attribute.Value();
    if (value.find("${") == std::string_view::npos && value.find("$(") == std::string_view::npos)
      return true;
    return bad(attribute, element, "is an expression of xacro: run xacro on the file first");
  }

  /// Refuses xacro elements at any depth. tinyxml2 limits the depth.
  bool plain(const XmlElement& element) {
    if (std::string_view(element.Name()).substr(0, 6) == "xacro:")
      return fail(element.GetLineNum(),
                  tag(element) + " belongs to xacro: run xacro on the file first");
    for (const XmlElement* child = element.FirstChildElement(); child != nullptr;
         child = child->NextSiblingElement()) {
      if (!plain(*child)) return false;
    }
    return true;
  }

  /// Refuses content after the outermost element.
  bool one_robot() {
    for (const tinyxml2::XMLNode* node = root_->NextSibling(); node != nullptr;
         node = node->NextSibling()) {
      if (node->ToComment() == nullptr && node->ToUnknown() == nullptr)
        return fail(node->GetLineNum(), "something follows </robot>, expected the end of the file");
    }
    return true;
  }

  /// Returns the error of tinyxml2 in words.
  std::string fault() const {
    const auto part = [id = document_.ErrorID()]() -> const char* {
      switch (id) {
        case tinyxml2::XML_ERROR_PARSING_ELEMENT: return "a tag is broken";
        case tinyxml2::XML_ERROR_PARSING_ATTRIBUTE: return "an attribute is broken or there twice";
        case tinyxml2::XML_ERROR_PARSING_TEXT: return "text does not end";
        case tinyxml2::XML_ERROR_PARSING_CDATA: return "a CDATA section does not end";
        case tinyxml2::XML_ERROR_PARSING_COMMENT: return "a comment does not end";
        case tinyxml2::XML_ERROR_PARSING_DECLARATION:
          return "a declaration is broken or in the wrong place";
        case tinyxml2::XML_ERROR_PARSING_UNKNOWN: return "a tag that begins with <! is broken";
        case tinyxml2::XML_ERROR_MISMATCHED_ELEMENT:
          return "an element is not closed by its own tag";
        case tinyxml2::XML_ELEMENT_DEPTH_EXCEEDED: return "elements are nested too deep";
        case tinyxml2::XML_ERROR_PARSING: return "it ends within an element";
        default: return "it cannot be parsed";
      }
    };
    std::string what = std::string("the file is not XML: ") + part();
    const std::string_view told = document_.ErrorStr() == nullptr ? "" : document_.ErrorStr();
    const std::string_view mark = "XMLElement name=";
    const std::size_t place = told.find(mark);
    return place == std::string_view::npos
               ? what
               : what + ", in <" + std::string(head_of(told.substr(place + mark.size()), 40)) + ">";
  }

  std::string file_, error_, owner_;
  tinyxml2::XMLDocument document_;
  const XmlElement* root_ = nullptr;
};

}  // namespace clothctl::inline CLOTHCTL_ABI::detail
