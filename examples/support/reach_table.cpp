#include "support/reach_table.hpp"

#include <functional>
#include <string>
#include <vector>

#include "support/reach_curves.hpp"

namespace program {

namespace {

struct Column {
  const char* name;
  std::function<double(const ReachRow&)> value;
};

const std::vector<Column>& columns() {
  static const std::vector<Column> all{
      {"seed", [](const ReachRow& r) { return static_cast<double>(r.seed); }},
      {"kind",
       [](const ReachRow& r) { return static_cast<double>((r.seed - 1) % reach_kinds().size()); }},
      {"verdict", [](const ReachRow& r) { return static_cast<double>(r.report.verdict); }},
      {"success", [](const ReachRow& r) { return r.success ? 1.0 : 0.0; }},
      {"score", [](const ReachRow& r) { return r.report.score; }},
      {"predicted_error_m", [](const ReachRow& r) { return r.report.predicted_error; }},
      {"predicted_largest_error_m",
       [](const ReachRow& r) { return r.report.predicted_largest_error; }},
      {"least_error_m", [](const ReachRow& r) { return r.report.least_error; }},
      {"mean_error_m", [](const ReachRow& r) { return r.finished ? r.run.mean_error_m : 1e9; }},
      {"max_error_m", [](const ReachRow& r) { return r.finished ? r.run.max_error_m : 1e9; }},
      {"distance_excess_m", [](const ReachRow& r) { return r.report.distance_excess.value; }},
      {"hand_speed_m_s", [](const ReachRow& r) { return r.report.hand_speed.value; }},
      {"hand_acceleration_m_s2",
       [](const ReachRow& r) { return r.report.hand_acceleration.value; }},
      {"fall_excess_m_s2", [](const ReachRow& r) { return r.report.fall_excess.value; }},
      {"cause_excess_m", [](const ReachRow& r) { return r.report.causes.excess; }},
      {"cause_largest_excess_m", [](const ReachRow& r) { return r.report.causes.largest_excess; }},
      {"cause_hand_m", [](const ReachRow& r) { return r.report.causes.hand; }},
      {"cause_feature_m", [](const ReachRow& r) { return r.report.causes.feature; }},
      {"cause_close_m", [](const ReachRow& r) { return r.report.causes.close; }},
      {"cause_tilt_m", [](const ReachRow& r) { return r.report.causes.tilt; }}};
  return all;
}

}  // namespace

clothctl::CsvWriter reach_table() {
  std::vector<std::string> names;
  for (const Column& column : columns()) names.emplace_back(column.name);
  return clothctl::CsvWriter(names);
}

void add_row(const ReachRow& row, clothctl::CsvWriter& table) {
  std::vector<double> values;
  for (const Column& column : columns()) values.push_back(column.value(row));
  table.add_row(values);
}

}  // namespace program
