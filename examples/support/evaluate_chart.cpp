#include "support/evaluate_chart.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace program {

namespace {

constexpr double kWidth = 720, kHeight = 320, kLeft = 64, kRight = 16, kTop = 34, kBottom = 46;

constexpr char kStyle[] = R"css(
:root { --bg: #f3f4f6; --panel: #fff; --ink: #12161c; --muted: #5b6573; --line: #e1e5ea;
  --c0: #2456e6; --c1: #c2185b; --c2: #1a7f4b; --c3: #b26a00; color-scheme: light dark; }
@media (prefers-color-scheme: dark) {
  :root { --bg: #0b0d11; --panel: #13161c; --ink: #edf0f5; --muted: #9aa4b3; --line: #262b35;
    --c0: #7aa2ff; --c1: #ff6fa5; --c2: #4cc38a; --c3: #f0a93b; } }
body { margin: 0 auto; padding: 20px 16px 40px; max-width: 760px; background: var(--bg);
  color: var(--ink); font: 14px/1.45 system-ui, "Segoe UI", Roboto, "Noto Sans", sans-serif;
  font-variant-numeric: tabular-nums; }
h1 { margin: 0; font-size: 20px; } p { margin: 2px 0 14px; color: var(--muted); }
.card { background: var(--panel); border: 1px solid var(--line); border-radius: 12px;
  margin: 12px 0; padding: 10px; overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-size: 13px; }
th { color: var(--muted); font-weight: 500; text-align: right; padding: 3px 8px; }
td { text-align: right; padding: 3px 8px; border-top: 1px solid var(--line); }
th:first-child, td:first-child { text-align: left; white-space: nowrap; }
svg { display: block; width: 100%; height: auto; }
svg text { font: 12px system-ui, "Segoe UI", Roboto, "Noto Sans", sans-serif; fill: var(--muted); }
svg .title { fill: var(--ink); font-weight: 600; font-size: 13px; }
svg .grid { stroke: var(--line); stroke-width: 1; }
svg .curve { fill: none; stroke-width: 1.8; stroke-linejoin: round; }
svg .mean { stroke-width: 3; }
svg .dot { fill-opacity: .45; }
pre { white-space: pre-wrap; overflow-wrap: anywhere; font-size: 12px; color: var(--muted); }
a { color: var(--c0); }
)css";

/// A number as text, at most `digits` digits.
std::string text_of(double value, int digits = 4) {
  char text[40];
  std::snprintf(text, sizeof text, "%.*g", digits, value);
  return text;
}

std::string at(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.1f", value);
  return text;
}

/// An axis: the range of its values and where they go on the page.
class Axis {
 public:
  Axis(double from, double to, bool log, double first, double last)
      : log_(log), first_(first), last_(last) {
    if (!(to > from)) to = from + (from == 0 ? 1 : std::abs(from));
    from_ = log ? std::log10(from) : from;
    to_ = log ? std::log10(to) : to;
    const double rest = 0.04 * (to_ - from_);
    to_ += rest;
    if (log || from < 0) from_ -= rest;
  }
  double place(double value) const {
    const double v = log_ ? std::log10(value) : value;
    return first_ + (last_ - first_) * (v - from_) / (to_ - from_);
  }
  /// Round values to mark.
  std::vector<double> ticks() const {
    std::vector<double> out;
    if (log_) {
      const bool wide = to_ - from_ > 2.5;
      for (double power = std::floor(from_); power <= to_; ++power) {
        for (const double digit : {1.0, 2.0, 5.0}) {
          const double value = digit * std::pow(10, power), v = std::log10(value);
          if (from_ <= v && v <= to_ && (digit == 1 || !wide)) out.push_back(value);
        }
      }
      return out;
    }
    const double raw = (to_ - from_) / 6, power = std::pow(10, std::floor(std::log10(raw)));
    const double share = raw / power, step = power * (share < 2 ? 2 : share < 5 ? 5 : 10);
    for (double k = std::ceil(from_ / step); k * step <= to_; ++k) out.push_back(k * step);
    return out;
  }

 private:
  bool log_;
  double from_ = 0, to_ = 1, first_, last_;
};

std::string label(double x, double y, const std::string& anchor, const std::string& text,
                  const std::string& more = "") {
  return "<text x='" + at(x) + "' y='" + at(y) + "' text-anchor='" + anchor + "' " + more + ">" +
         html_text(text) + "</text>";
}

std::string line(double x0, double y0, double x1, double y1, const std::string& kind) {
  return "<line class='" + kind + "' x1='" + at(x0) + "' y1='" + at(y0) + "' x2='" + at(x1) +
         "' y2='" + at(y1) + "'/>";
}

std::string dot(double x, double y, int colour, double radius = 3.2) {
  return "<circle class='dot' style='fill:var(--c" + std::to_string(colour) + ")' cx='" + at(x) +
         "' cy='" + at(y) + "' r='" + at(radius) + "'/>";
}

/// The range of a coordinate, from zero on if that fits.
std::pair<double, double> range(const std::vector<Series>& all, bool of_y, bool log) {
  double least = 1e300, most = -1e300;
  for (const Series& s : all) {
    for (const auto& [x, y] : s.points) {
      least = std::min(least, of_y ? y : x);
      most = std::max(most, of_y ? y : x);
    }
  }
  if (least > most) return {log ? 1.0 : 0.0, log ? 10.0 : 1.0};
  return {!log && least > 0 ? 0.0 : least, most};
}

/// A chart without marks: title, grid, ticks and labels.
std::string frame(const Chart& chart, const Axis& x, const Axis& y) {
  const double bottom = kHeight - kBottom;
  std::string out = label(kLeft, 18, "start", chart.title, "class='title'");
  for (const double v : y.ticks()) {
    out += line(kLeft, y.place(v), kWidth - kRight, y.place(v), "grid") +
           label(kLeft - 8, y.place(v) + 4, "end", text_of(v));
  }
  for (const double v : x.ticks()) {
    out += line(x.place(v), kTop, x.place(v), bottom, "grid") +
           label(x.place(v), bottom + 17, "middle", text_of(v));
  }
  out += label((kLeft + kWidth - kRight) / 2, kHeight - 8, "middle", chart.x_label);
  const std::string middle = at((kTop + bottom) / 2);
  return out + label(0, 0, "middle", chart.y_label,
                     "transform='translate(14 " + middle + ") rotate(-90)'");
}

std::string draw(const Series& s, const Axis& x, const Axis& y) {
  std::string out, path;
  for (const auto& [a, b] : s.points) {
    if (s.dots) out += dot(x.place(a), y.place(b), s.colour);
    path.append(1, path.empty() ? 'M' : 'L')
        .append(at(x.place(a)))
        .append(1, ' ')
        .append(at(y.place(b)));
  }
  if (s.line && !path.empty()) {
    out += "<path class='curve' style='stroke:var(--c" + std::to_string(s.colour) + ")" +
           (s.dashed ? ";stroke-dasharray:5 4" : "") + "' d='" + path + "'/>";
  }
  return out;
}

std::string start(double height) {
  return "<svg viewBox='0 0 " + text_of(kWidth) + " " + text_of(height) + "' role='img'>";
}

}  // namespace

std::string html_text(const std::string& text) {
  std::string out;
  for (const char c : text) {
    const std::string safe = c == '&'    ? "&amp;"
                             : c == '<'  ? "&lt;"
                             : c == '>'  ? "&gt;"
                             : c == '\'' ? "&#39;"
                             : c == '"'  ? "&quot;"
                                         : std::string(1, c);
    out += safe;
  }
  return out;
}

std::string svg(const Chart& chart) {
  const auto [left, right] = range(chart.series, false, chart.log_x);
  const auto [low, high] = range(chart.series, true, chart.log_y);
  const Axis x(left, right, chart.log_x, kLeft, kWidth - kRight);
  const Axis y(low, high, chart.log_y, kHeight - kBottom, kTop);
  std::string out = start(kHeight) + frame(chart, x, y);
  double legend = kWidth - kRight;
  for (auto s = chart.series.rbegin(); s != chart.series.rend(); ++s) {
    out += draw(*s, x, y);
    if (s->name.empty()) continue;
    out +=
        label(legend, 18, "end", s->name, "style='fill:var(--c" + std::to_string(s->colour) + ")'");
    legend -= 6.6 * static_cast<double>(s->name.size()) + 14;
  }
  return out + "</svg>";
}

std::string svg(const Strips& strips) {
  constexpr double row_height = 28, names = 168, numbers = 76;
  const double bottom = kTop + row_height * static_cast<double>(strips.rows.size());
  const auto [left, right] = range(strips.rows, false, false);
  const Axis x(left, right, false, names, kWidth - numbers);
  std::string out =
      start(bottom + kBottom) + label(names, 18, "start", strips.title, "class='title'");
  for (const double v : x.ticks()) {
    out += line(x.place(v), kTop, x.place(v), bottom, "grid") +
           label(x.place(v), bottom + 17, "middle", text_of(v));
  }
  double y = kTop + row_height / 2;
  for (const Series& row : strips.rows) {
    double mean = 0;
    for (const auto& point : row.points) {
      out += dot(x.place(point.first), y, row.colour, 4);
      mean += point.first / static_cast<double>(row.points.size());
    }
    out += label(names - 10, y + 4, "end", row.name);
    if (!row.points.empty()) {
      out += "<g style='stroke:var(--c" + std::to_string(row.colour) + ")'>" +
             line(x.place(mean), y - 8, x.place(mean), y + 8, "mean") + "</g>";
    }
    out += label(kWidth - 4, y + 4, "end", row.points.empty() ? "no run" : text_of(mean, 3));
    y += row_height;
  }
  out += label((names + kWidth - numbers) / 2, bottom + kBottom - 8, "middle", strips.x_label);
  return out + "</svg>";
}

std::string chart_page(const std::string& title, const std::string& subtitle,
                       const std::string& body) {
  return "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'>"
         "<meta name='viewport' content='width=device-width, initial-scale=1'><title>" +
         html_text(title) + "</title><style>" + kStyle + "</style></head><body><h1>" +
         html_text(title) + "</h1><p>" + html_text(subtitle) + "</p>" + body + "</body></html>\n";
}

}  // namespace program
