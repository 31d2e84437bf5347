#pragma once

// Patterns of everyday cloth: handkerchief, towel, scarf, T-shirt, tank top. World frame, z up; the
// wearer looks along -y.
//
// The body of a shirt, seen from the front of the panel, x to the right, y up from the hem:
//
//        5    4    3          sides    0 hem           4 neck
//      ____.     .____                 1 right side    5 left shoulder
//    6(     `---'     )2               2 right armhole 6 left armhole
//      \             /                 3 right shoulder 7 left side
//    7 |             | 1
//      |_____________|
//             0
//
// A sleeve, the line of the arm upwards: 0 cuff, 1 right edge, 2 right half of the cap, 3 left half
// of the cap, 4 left edge. Edges 1 and 4 are sewn together under the arm. The cap is a little
// longer than the armhole (eased), which gives the shoulder its roundness. All sides of a seam run
// in opposite directions (garment.hpp).

#include <cmath>
#include <string>
#include <utility>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/result.hpp"
#include "clothctl/mesh/garment.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// Sizes of a shirt, m, measured on the flat garment. The defaults are a T-shirt of size M.
struct ShirtSizes {
  /// Width of the body under the arms; half of its girth.
  double chest = 0.52;
  /// Width at the hem.
  double hem = 0.52;
  /// Height from the hem to the neck end of the shoulder.
  double length = 0.73;
  /// Distance of the two outer ends of the shoulders.
  double shoulders = 0.45;
  /// Height of the neck end of a shoulder over its outer end.
  double slope = 0.045;
  /// Width of the neck.
  double neck = 0.19;
  /// Depth of the neck in front.
  double front_neck = 0.10;
  /// Depth of the neck at the back.
  double back_neck = 0.025;
  /// Height of the armhole, from the underarm to the outer end of the shoulder.
  double armhole = 0.225;
  /// Width of the sleeve at the underarm, its girth.
  double sleeve = 0.41;
  /// Width of the sleeve at the cuff.
  double cuff = 0.35;
  /// Length of the sleeve from cuff to underarm.
  double sleeve_length = 0.11;
  /// Height of the sleeve's cap over the underarm.
  double cap = 0.132;
  /// Radius of the cylinder around the body on which front and back lie at the start.
  double body_radius = 0.185;

  /// Returns an empty string when all sizes are positive and fit each other, else a line that names
  /// the first bad one.
  std::string validate() const {
    const std::pair<const char*, double> all[] = {{"chest", chest},
                                                  {"hem", hem},
                                                  {"length", length},
                                                  {"shoulders", shoulders},
                                                  {"slope", slope},
                                                  {"neck", neck},
                                                  {"front_neck", front_neck},
                                                  {"back_neck", back_neck},
                                                  {"armhole", armhole},
                                                  {"sleeve", sleeve},
                                                  {"cuff", cuff},
                                                  {"sleeve_length", sleeve_length},
                                                  {"cap", cap},
                                                  {"body_radius", body_radius}};
    for (const auto& [name, value] : all) {
      if (!is_finite(value) || !(value > 0))
        return std::string("shirt size ") + name + " must be positive, got " + number_text(value);
    }
    if (!(neck < shoulders))
      return "shirt size neck must be below shoulders, got " + number_text(neck) + " and " +
             number_text(shoulders);
    if (!(shoulders < chest))
      return "shirt size shoulders must be below chest, got " + number_text(shoulders) + " and " +
             number_text(chest);
    if (!(armhole + slope < length) || !(front_neck < length))
      return "shirt size length must exceed armhole + slope and front_neck, got " +
             number_text(length);
    return {};
  }
};

namespace detail {

/// The front (or back, by the depth of its neck) of a shirt.
template <class = void>
PanelOutline shirt_body(const ShirtSizes& s, double neck_depth) {
  const double chest = s.chest / 2, hem = s.hem / 2, tip = s.shoulders / 2, neck = s.neck / 2;
  const double top = s.length, outer = top - s.slope, under = outer - s.armhole;
  const double in = tip - 0.045 * s.shoulders;  // the armhole curves in below the shoulder
  PanelOutline body(FlatPoint(-hem, 0));
  body.line_to({hem, 0}).line_to({chest, under});
  body.curve_to({in, under + 0.02 * s.armhole}, {in, under + 0.45 * s.armhole}, {tip, outer});
  body.line_to({neck, top});
  // Two control points straight below the ends would make a U; a little inwards makes it round.
  const double low = top - neck_depth / 0.75;
  body.curve_to({0.75 * neck, low}, {-0.75 * neck, low}, {-neck, top});
  body.line_to({-tip, outer});
  body.curve_to({-in, under + 0.45 * s.armhole}, {-in, under + 0.02 * s.armhole}, {-chest, under});
  body.line_to({-hem, 0});
  return body;
}

template <class = void>
PanelOutline shirt_sleeve(const ShirtSizes& s) {
  const double width = s.sleeve / 2, cuff = s.cuff / 2, under = s.sleeve_length;
  PanelOutline sleeve(FlatPoint(-cuff, 0));
  sleeve.line_to({cuff, 0}).line_to({width, under});
  sleeve.curve_to({0.55 * width, under + 0.06 * s.cap}, {0.48 * width, under + s.cap},
                  {0, under + s.cap});
  sleeve.curve_to({-0.48 * width, under + s.cap}, {-0.55 * width, under + 0.06 * s.cap},
                  {-width, under});
  sleeve.line_to({-cuff, 0});
  return sleeve;
}

/// Adds front and back with their side and shoulder seams. They are the panels 0 and 1.
template <class = void>
void add_shirt_body(const ShirtSizes& s, GarmentPattern& pattern) {
  PanelPlacement front, back;
  front.origin = {0, -s.body_radius, 0};
  back.origin = {0, s.body_radius, 0};
  back.right = {-1, 0, 0};
  front.radius = back.radius = s.body_radius;
  const int f = pattern.add_panel("front", shirt_body(s, s.front_neck), front);
  const int b = pattern.add_panel("back", shirt_body(s, s.back_neck), back);
  for (const auto& [side_f, side_b] :
       {std::pair(1, 7), std::pair(7, 1), std::pair(3, 5), std::pair(5, 3)})
    pattern.sew(f, side_f, b, side_b, 0.02);
}

/// Adds the sleeve at x > 0 (`right` = 1) or x < 0 (-1).
template <class = void>
void add_sleeve(const ShirtSizes& s, int right, GarmentPattern& pattern) {
  const double angle = 0.6, sign = right;  // the arm hangs 0.6 rad below the horizontal
  PanelPlacement place;
  place.up = {-sign * std::cos(angle), 0, std::sin(angle)};  // from the cuff to the shoulder
  place.right = {0, sign, 0};
  place.radius = s.sleeve / 6;  // somewhat wider than closed
  const double out = s.sleeve_length + s.cap;
  const Vector3<double> shoulder(sign * 0.95 * s.body_radius, 0, s.length - s.slope);
  place.origin = shoulder - out * place.up;
  const int panel =
      pattern.add_panel(right > 0 ? "sleeve at +x" : "sleeve at -x", shirt_sleeve(s), place);
  pattern.sew(panel, 1, panel, 4, 0.02);
  // The right half of the cap (y > 0 for the sleeve at +x) belongs to the back there.
  const int front = 0, back = 1;
  pattern.sew(panel, 2, right > 0 ? back : front, 6);
  pattern.sew(panel, 3, right > 0 ? front : back, 2);
}

template <class = void>
GarmentPattern rectangle_pattern(const char* name, double width, double height) {
  GarmentPattern pattern;
  PanelPlacement place;
  place.origin = {-width / 2, 0, -height};
  pattern.add_panel(name, rectangle_outline(width, height), place);
  return pattern;
}

}  // namespace detail

/// Returns a square handkerchief of 0.4 m in the x-z plane, its top edge at z = 0 centred at x = 0.
/// Allocates.
template <class = void>
GarmentPattern handkerchief_pattern(double size = 0.4) {
  return detail::rectangle_pattern("handkerchief", size, size);
}

/// Returns a hand towel, by default 0.5 m × 1 m, placed like the handkerchief. Allocates.
template <class = void>
GarmentPattern towel_pattern(double width = 0.5, double height = 1.0) {
  return detail::rectangle_pattern("towel", width, height);
}

/// Returns a scarf, by default 0.3 m × 1.8 m, placed like the handkerchief. Allocates.
template <class = void>
GarmentPattern scarf_pattern(double width = 0.3, double height = 1.8) {
  return detail::rectangle_pattern("scarf", width, height);
}

/// The edge length (m) at which the default T-shirt has about 13 000 vertices.
inline constexpr double kTshirtEdgeLength = 0.0086;

/// Returns a T-shirt of four panels: 0 front, 1 back, 2 the sleeve at x > 0, 3 the sleeve at x < 0.
/// Hem at z = 0. Seams: sides, shoulders, then underarm and cap of each sleeve. Allocates. Fails
/// when: `sizes.validate()` finds a fault. `make_garment` fails when the sleeve does not fit the
/// armhole within 10 %.
template <class = void>
Result<GarmentPattern> tshirt_pattern(const ShirtSizes& sizes = {}) {
  if (std::string wrong = sizes.validate(); !wrong.empty()) return Error{std::move(wrong)};
  GarmentPattern pattern;
  detail::add_shirt_body(sizes, pattern);
  detail::add_sleeve(sizes, 1, pattern);
  detail::add_sleeve(sizes, -1, pattern);
  return pattern;
}

/// Returns the default sizes of a tank top: narrow shoulders, deep neck and armholes.
template <class = void>
ShirtSizes tank_top_sizes() {
  ShirtSizes s;
  s.chest = s.hem = 0.48;
  s.length = 0.70;
  s.shoulders = 0.32;
  s.slope = 0.02;
  s.neck = 0.20;
  s.front_neck = 0.17;
  s.back_neck = 0.09;
  s.armhole = 0.24;
  s.body_radius = 0.17;
  return s;
}

/// Returns a tank top, a shirt without sleeves: 0 front, 1 back. Sizes of the sleeve are not used.
/// Allocates. Fails when: `sizes.validate()` finds a fault.
template <class = void>
Result<GarmentPattern> tank_top_pattern(const ShirtSizes& sizes = tank_top_sizes()) {
  if (std::string wrong = sizes.validate(); !wrong.empty()) return Error{std::move(wrong)};
  GarmentPattern pattern;
  detail::add_shirt_body(sizes, pattern);
  return pattern;
}

}  // namespace clothctl::inline CLOTHCTL_ABI
