#pragma once

// Charts as SVG text for a page without scripts: lines and dots over numbers, and strips of dots,
// one for each case.

#include <string>
#include <utility>
#include <vector>

namespace program {

/// Points of a chart, or of a strip (then only x counts).
struct Series {
  std::string name;
  std::vector<std::pair<double, double>> points;
  bool line = true;
  bool dots = false;
  bool dashed = false;
  int colour = 0;  // 0 to 3
};

/// A chart over numbers. Axes start at zero, unless they are logarithmic or have values below it.
struct Chart {
  std::string title, x_label, y_label;
  std::vector<Series> series;
  bool log_x = false, log_y = false;
};

/// Strips of dots: a row for each series, with its mean as a bar.
struct Strips {
  std::string title, x_label;
  std::vector<Series> rows;
};

/// Returns a chart as an SVG element.
std::string svg(const Chart& chart);
std::string svg(const Strips& strips);

/// Returns text with the characters escaped that mean something in HTML.
std::string html_text(const std::string& text);

/// Returns a self-contained page. `body`: HTML.
std::string chart_page(const std::string& title, const std::string& subtitle,
                       const std::string& body);

}  // namespace program
