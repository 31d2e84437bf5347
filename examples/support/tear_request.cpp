#include "support/tear_request.hpp"

#include "support/command_line.hpp"

namespace program {

TearRequest read_tear_request(int argc, char** argv) {
  TearRequest o;
  CLI::App app{"A sheet is cut along a drawn line and pulled apart until it tears."};
  add_sheet(app, o.cloth, o.size, o.material);
  app.add_option("--model", o.model, "mass-spring or pbd")
      ->check(CLI::IsMember({"mass-spring", "pbd"}))
      ->capture_default_str();
  app.add_option("--limit", o.limit, "Strain at which springs break; 0: never")
      ->check(between(0, 100))
      ->capture_default_str();
  app.add_option("--pull", o.pull, "Distance that the sides are pulled apart, share of the size")
      ->check(between(0, 10))
      ->capture_default_str();
  app.add_option("--cut", o.cut, "x,z,x,z,… in shares of the sheet, from its lower left corner")
      ->delimiter(',')
      ->capture_default_str();
  app.add_flag("--whole", o.whole, "No cut");
  app.add_option("--seconds", o.seconds, "Length of the run, s")
      ->check(between(0.1, 100))
      ->capture_default_str();
  app.add_option("--out", o.out, "Folder for player.html (made if missing)")
      ->check([](const std::string& text) {
        return text.empty() ? std::string("is empty") : std::string();
      });
  app.add_flag("--json", o.json, "Print the figures as one JSON object");
  parse(app, argc, argv);
  if (o.cut.size() % 2 != 0 || o.cut.size() < 4)
    refuse("--cut: needs two or more points x,z, got " + std::to_string(o.cut.size()) + " numbers");
  return o;
}

clothctl::Points<double> cut_line(const TearRequest& o) {
  clothctl::Points<double> line(3, static_cast<clothctl::Index>(o.cut.size() / 2));
  for (clothctl::Index i = 0; i < line.cols(); ++i) {
    const std::size_t at = 2 * static_cast<std::size_t>(i);
    line.col(i) << o.size * (o.cut[at] - 0.5), 0, o.size * (o.cut[at + 1] - 1);
  }
  return line;
}

}  // namespace program
