#pragma once

// The material of a sheet, in SI units and independent of the mesh. A woven sheet has two families
// of threads: the warp, which runs along the columns of a grid, and the weft, which runs along its
// rows. On a grid of square cells of size dx the springs and stencils have the stiffnesses
//
//   edges       k  = stretch_warp in columns, stretch_weft in rows (half on the border)
//   diagonals   k  = shear
//   bending     kb = bending_warp / dx² on columns, bending_weft / dx² on rows
//
// As a membrane of thickness t such a grid has C11 = stretch + shear along either thread, C12 =
// shear and the shear modulus G t = shear (N/m); its bending energy is U = ½ ∫ bending_warp κ_warp²
// + bending_weft κ_weft² dA with the curvatures κ of the threads. sheet.hpp states the rules for
// rectangular cells and for triangles. docs/cloth_materials.md describes the presets and the
// sources of their values.

#include <array>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "clothctl/core/number_text.hpp"
#include "clothctl/core/quoted_text.hpp"
#include "clothctl/core/result.hpp"

namespace clothctl::inline CLOTHCTL_ABI {

/// The material of a sheet. The defaults are the preset "handkerchief".
template <RealScalar Scalar>
struct Material {
  /// The name in reports and messages. It may hold any text.
  std::string name = "handkerchief";
  /// Mass per area, kg/m².
  Scalar area_density = Scalar(0.2);
  /// Membrane stiffness along the warp, N/m: the spring constant of an edge between square cells,
  /// in a column of the grid.
  Scalar stretch_warp = Scalar(1000.0);
  /// The same along the weft, in a row.
  Scalar stretch_weft = Scalar(1000.0);
  /// Membrane stiffness against shear, N/m: the spring constant of a diagonal of a square cell.
  Scalar shear = Scalar(200.0);
  /// Bending stiffness B per width of a sheet whose warp threads are curved, N m.
  Scalar bending_warp = Scalar(2e-5);
  /// The same with curved weft threads.
  Scalar bending_weft = Scalar(2e-5);
  /// Axial damping time β, s: every spring has a damper d = β k.
  Scalar damping_time = Scalar(0.002);
  /// Mass-proportional drag α, 1/s: force -α m v. Drag, friction and air are not part of a spring
  /// network; MassSpringSettings::of, PositionBasedSettings::of and make_pinch take them.
  Scalar drag = Scalar(0.5);
  /// Coefficient of friction μ between cloth and finger.
  Scalar friction = Scalar(0.5);
  /// Drag coefficient of a triangle in air flowing along its normal, dimensionless.
  Scalar air_normal = Scalar(1.0);
  /// Drag coefficient of a triangle in air flowing along its plane, dimensionless.
  Scalar air_tangent = Scalar(0.1);

  /// Sets the membrane stiffness along warp and weft, N/m.
  void set_stretch(const Scalar& value) { stretch_warp = stretch_weft = value; }
  /// Sets the bending stiffness of warp and weft, N m.
  void set_bending(const Scalar& value) { bending_warp = bending_weft = value; }

  /// Returns an empty string when density and stretch are positive and the others at least zero;
  /// else a line that names the material, the quantity and its value.
  std::string validate() const {
    const Scalar zero = Scalar(0);
    const std::array<std::pair<const char*, const Scalar*>, 11> quantities{
        {{"area_density", &area_density},
         {"stretch_warp", &stretch_warp},
         {"stretch_weft", &stretch_weft},
         {"shear", &shear},
         {"bending_warp", &bending_warp},
         {"bending_weft", &bending_weft},
         {"damping_time", &damping_time},
         {"drag", &drag},
         {"friction", &friction},
         {"air_normal", &air_normal},
         {"air_tangent", &air_tangent}}};
    for (std::size_t i = 0; i < quantities.size(); ++i) {
      const Scalar& value = *quantities[i].second;
      const std::string item = "material " + quoted_text(name) + ": " + quantities[i].first;
      if (!is_finite(value)) return item + " is not a finite number";
      if (i < 3 && !(zero < value)) return item + " must be positive, got " + number_text(value);
      if (value < zero) return item + " must not be negative, got " + number_text(value);
    }
    return {};
  }
};

namespace detail {

/// A row of the table of presets, which are the same along warp and weft. The air coefficients are
/// those of the default material.
struct MaterialRow {
  double area_density, stretch, shear, bending, damping_time, drag, friction;
};

inline constexpr std::array<std::string_view, 10> kMaterialNames{
    "handkerchief", "iri", "cotton", "silk", "denim", "wool", "felt", "knit", "towel", "paper"};

inline constexpr std::array<MaterialRow, 10> kMaterialRows{{
    {0.20, 1000.0, 200.0, 2e-5, 0.002, 0.5, 0.5},     // handkerchief
    {1.10, 3000.0, 600.0, 2e-5, 0.002, 0.5, 0.5},     // iri
    {0.12, 5000.0, 60.0, 8e-6, 0.002, 0.5, 0.5},      // cotton
    {0.06, 4000.0, 20.0, 3e-6, 0.002, 0.8, 0.3},      // silk
    {0.40, 10000.0, 180.0, 5e-5, 0.002, 0.3, 0.6},    // denim
    {0.25, 3000.0, 45.0, 1.2e-5, 0.002, 0.4, 0.5},    // wool
    {0.30, 2000.0, 1000.0, 1.5e-4, 0.004, 0.4, 0.6},  // felt
    {0.20, 400.0, 35.0, 5e-6, 0.004, 0.5, 0.6},       // knit
    {0.40, 2500.0, 70.0, 3e-5, 0.004, 0.4, 0.8},      // towel
    {0.08, 40000.0, 15000.0, 3e-4, 0.001, 0.8, 0.4}   // paper
}};

}  // namespace detail

/// Returns the names of the presets. The first is the default of the example programs.
inline std::span<const std::string_view> material_names() { return detail::kMaterialNames; }

/// Returns the preset of a name. Allocates. Fails when: no preset has this name (the message lists
/// all names).
template <RealScalar Scalar = double>
Result<Material<Scalar>> material_preset(std::string_view name) {
  for (std::size_t i = 0; i < detail::kMaterialNames.size(); ++i) {
    if (detail::kMaterialNames[i] != name) continue;
    const detail::MaterialRow& row = detail::kMaterialRows[i];
    Material<Scalar> material;
    material.name = std::string(name);
    material.area_density = Scalar(row.area_density);
    material.set_stretch(Scalar(row.stretch));
    material.shear = Scalar(row.shear);
    material.set_bending(Scalar(row.bending));
    material.damping_time = Scalar(row.damping_time);
    material.drag = Scalar(row.drag);
    material.friction = Scalar(row.friction);
    return material;
  }
  std::string message = "unknown material " + quoted_text(name) + "; known:";
  for (std::string_view known : detail::kMaterialNames) {
    message += ' ';
    message += known;
  }
  return Error{message};
}

}  // namespace clothctl::inline CLOTHCTL_ABI
