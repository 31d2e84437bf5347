#include "support/evaluate_report.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "clothctl/io/csv.hpp"
#include "support/evaluate_chart.hpp"
#include "support/figure_text.hpp"
#include "support/timing.hpp"

namespace program {

namespace {

using Json = nlohmann::ordered_json;

/// Returns the rows of a case that ran to the end.
std::vector<Row> finished_rows(const std::vector<Row>& rows, const Case& c) {
  std::vector<Row> out;
  for (const Row& row : rows) {
    if (row.study_case == c.name && row.finished()) out.push_back(row);
  }
  return out;
}

double mean(const std::vector<Row>& rows, double Row::*value) {
  double sum = 0;
  for (const Row& row : rows) sum += row.*value;
  return sum / static_cast<double>(rows.size());  // without rows not a number: null in JSON
}

double most(const std::vector<Row>& rows, double Row::*value) {
  double out = rows.empty() ? std::nan("") : 0.0;
  for (const Row& row : rows) out = std::max(out, row.*value);
  return out;
}

double median(const std::vector<Row>& rows, double Row::*value) {
  std::vector<double> values;
  for (const Row& row : rows) values.push_back(row.*value);
  return values.empty() ? std::nan("") : quantile(values, 0.5);
}

/// The errors of cases along the axis of the study: dots of runs and the mean.
Chart error_chart(const std::vector<Case>& cases, const std::vector<Row>& rows, double scale,
                  const std::string& title, const std::string& x_label) {
  Series means{"mean", {}, true, false, false, 0}, dots{"each curve", {}, false, true, false, 1};
  for (const Case& c : cases) {
    const std::vector<Row> done = finished_rows(rows, c);
    for (const Row& row : done) dots.points.push_back({scale * c.value, 1000 * row.mean_error_m});
    if (!done.empty())
      means.points.push_back({scale * c.value, 1000 * mean(done, &Row::mean_error_m)});
  }
  return {title, x_label, "mean error, mm", {means, dots}};
}

/// The error of every run against a property of its curve.
Chart curve_chart(const std::vector<Row>& rows, double Row::*property, const std::string& x_label) {
  Series dots{"", {}, false, true, false, 0};
  for (const Row& row : rows) {
    if (row.finished()) dots.points.push_back({row.*property, 1000 * row.mean_error_m});
  }
  return {"Error of each curve", x_label, "mean error, mm", {dots}};
}

Strips error_strips(const std::vector<Case>& cases, const std::vector<Row>& rows) {
  Strips strips{
      "Mean error of each curve; the bar and the number are their mean", "mean error, mm", {}};
  for (const Case& c : cases) {
    Series series{c.name, {}, false, true, false, 0};
    for (const Row& row : finished_rows(rows, c))
      series.points.push_back({1000 * row.mean_error_m, 0});
    strips.rows.push_back(series);
  }
  return strips;
}

/// Figure 8: x of a corner and of its target in the first run.
std::string position_charts(const ResultFolder& folder) {
  const std::string file = folder.path() + "/" + first_run_folder() + "/trajectory.csv";
  const auto table = clothctl::read_csv(file, clothctl::CsvHeader::Names);
  if (!table || table->values.cols() < 15) return {};
  std::string out;
  for (const clothctl::Index corner : {0, 1}) {
    Series target{"target", {}, true, false, true, 1}, cloth{"cloth", {}, true, false, false, 0};
    for (clothctl::Index i = 0; i < table->values.rows(); ++i) {
      const double t = table->values(i, 0);
      target.points.push_back({t, table->values(i, 1 + 7 * corner)});
      cloth.points.push_back({t, table->values(i, 4 + 7 * corner)});
    }
    out += "<div class='card'>" +
           svg(Chart{std::string("First run: x of the lower ") + (corner == 0 ? "left" : "right") +
                         " corner",
                     "time, s",
                     "x, m",
                     {cloth, target}}) +
           "</div>";
  }
  return out + "<p><a href='" + first_run_folder() + "/player.html'>Watch the first run</a></p>";
}

/// Table 1: time to plan a frame by the size of the sheet.
Chart time_chart(const std::vector<Case>& cases, const std::vector<Row>& rows) {
  Series ours{"clothctl", {}, true, true, false, 0};
  for (const Case& c : cases) {
    const std::vector<Row> done = finished_rows(rows, c);
    if (!done.empty()) ours.points.push_back({c.value, median(done, &Row::frame_ms_median)});
  }
  // 1 h 56 m for 250 frames of 4225 vertices.
  const Series paper{"paper", {{4225, 27840}}, false, true, false, 1};
  return {"Time to plan a frame", "vertices", "ms", {ours, paper}, true, true};
}

std::string cell(const Json& value, double scale) {
  if (!value.is_number()) return value.is_string() ? html_text(value.get<std::string>()) : "–";
  return figure_text(value.is_number_float() ? Json(scale * value.get<double>()) : value);
}

std::string case_table(const Json& summary) {
  std::string out =
      "<div class='card'><table><tr><th>case</th><th>runs</th><th>failed</th>"
      "<th>mean error, mm</th><th>worst curve, mm</th><th>largest error, mm</th>"
      "<th>planning, ms a frame</th><th>99 %, ms</th><th>planning, s a run</th></tr>";
  for (const Json& c : summary["cases"]) {
    out += "<tr>";
    for (const auto& [key, scale] :
         std::vector<std::pair<const char*, double>>{{"case", 1.0},
                                                     {"runs", 1.0},
                                                     {"failed", 1.0},
                                                     {"mean_error_m", 1000.0},
                                                     {"worst_curve_m", 1000.0},
                                                     {"max_error_m", 1000.0},
                                                     {"frame_ms_median", 1.0},
                                                     {"frame_ms_p99", 1.0},
                                                     {"planning_s", 1.0}})
      out += "<td>" + cell(c[key], scale) + "</td>";
    out += "</tr>";
  }
  return out + "</table></div>";
}

/// The plots of a study, as HTML.
std::string charts(const Evaluation& e, const std::vector<Case>& cases,
                   const std::vector<Row>& rows, const ResultFolder& folder) {
  const auto card = [](const std::string& text) { return "<div class='card'>" + text + "</div>"; };
  if (e.study == "sd")
    return card(svg(error_chart(cases, rows, 1000, "Error against noise of the curves",
                                "standard deviation of the control points, mm"))) +
           card(svg(curve_chart(rows, &Row::curve_speed_mean, "mean speed of the curve, m/s"))) +
           card(svg(curve_chart(rows, &Row::curve_length_m, "length of the curve, m")));
  if (e.study == "window") {
    Chart error = error_chart(cases, rows, 1, "Error against window size", "window size K, frames");
    error.log_y = true;
    Series time{"", {}, true, true, false, 2};
    for (const Case& c : cases) {
      const std::vector<Row> done = finished_rows(rows, c);
      if (!done.empty()) time.points.push_back({c.value, median(done, &Row::frame_ms_median)});
    }
    return card(svg(error)) +
           card(svg(Chart{"Time to plan a frame", "window size K, frames", "ms, median", {time}}));
  }
  if (e.study == "table1")
    return card(svg(time_chart(cases, rows))) + card(svg(error_strips(cases, rows)));
  std::string out = card(svg(error_strips(cases, rows)));
  if (cases.size() == 1)
    out += card(svg(curve_chart(rows, &Row::curve_speed_mean, "mean speed of the curve, m/s")));
  return out + position_charts(folder);
}

}  // namespace

Json summarise(const Evaluation& e, const std::vector<Case>& cases, const std::vector<Row>& rows,
               std::size_t runs) {
  Json j;
  j["status"] = rows.size() == runs ? "finished" : "incomplete";
  j["study"] = e.study;
  j["runs"] = rows.size();
  j["missing"] = runs - rows.size();
  j["failed"] = std::count_if(rows.begin(), rows.end(), [](const Row& r) { return !r.finished(); });
  j["cases"] = Json::array();
  for (const Case& c : cases) {
    const std::vector<Row> done = finished_rows(rows, c);
    const auto all = std::count_if(rows.begin(), rows.end(),
                                   [&](const Row& r) { return r.study_case == c.name; });
    j["cases"].push_back({{"case", c.name},
                          {"value", c.value},
                          {"runs", all},
                          {"failed", all - static_cast<std::ptrdiff_t>(done.size())},
                          {"mean_error_m", mean(done, &Row::mean_error_m)},
                          {"worst_curve_m", most(done, &Row::mean_error_m)},
                          {"p95_error_m", mean(done, &Row::p95_error_m)},
                          {"max_error_m", most(done, &Row::max_error_m)},
                          {"frame_ms_median", median(done, &Row::frame_ms_median)},
                          {"frame_ms_p99", median(done, &Row::frame_ms_p99)},
                          {"plant_ms_median", median(done, &Row::plant_ms_median)},
                          {"planning_s", mean(done, &Row::planning_s)}});
  }
  j["setup"] = settings_json(e);
  return j;
}

void write_report(const ResultFolder& folder, const Evaluation& e, const std::vector<Case>& cases,
                  const std::vector<Row>& rows, const Json& summary) {
  std::vector<std::string> results, times;
  for (const Row& row : rows) {
    results.push_back(result_cells(row));
    times.push_back(time_cells(row));
  }
  const Json& settings = summary["setup"];
  folder.write("results.csv", table_text(settings, result_columns(), results));
  folder.write("times.csv", table_text(settings, time_columns(), times));
  folder.write("summary.json", summary.dump(2) + "\n");
  const std::string subtitle = std::to_string(rows.size()) + " runs, " + summary["missing"].dump() +
                               " missing, " + summary["failed"].dump() + " failed; " +
                               settings["material"]["name"].get<std::string>();
  folder.write("report.html", chart_page("Evaluation: study " + e.study, subtitle,
                                         charts(e, cases, rows, folder) + case_table(summary) +
                                             "<div class='card'><pre>" +
                                             html_text(settings.dump(2)) + "</pre></div>"));
}

void print_summary(const Json& summary, const ResultFolder& folder) {
  std::printf("%s: %s runs, %s missing, %s failed\n", summary["status"].get<std::string>().c_str(),
              summary["runs"].dump().c_str(), summary["missing"].dump().c_str(),
              summary["failed"].dump().c_str());
  for (const Json& c : summary["cases"]) {
    std::printf("%-26s mean error %s mm, worst curve %s mm, planning %s ms a frame\n",
                c["case"].get<std::string>().c_str(), cell(c["mean_error_m"], 1000).c_str(),
                cell(c["worst_curve_m"], 1000).c_str(), cell(c["frame_ms_median"], 1).c_str());
  }
  std::printf("open %s/report.html\n", folder.path().c_str());
}

}  // namespace program
