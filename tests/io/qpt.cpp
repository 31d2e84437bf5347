// QPT: every section is read, errors are named, and no text crashes the reader.

#include "clothctl/io/qpt.hpp"

#include <map>
#include <sstream>
#include <string>

#include "clothctl/io/csv.hpp"
#include "io/qpt_programs.hpp"
#include "io/spoilt_text.hpp"
#include "support/catch.hpp"
#include "support/reading.hpp"
#include "support/shared_data.hpp"

using clothctl::parse_qpt;
using clothctl::parse_qpt_solution;
using clothctl::QpProblem;
using clothctl::QpSolution;
using namespace clothctl_test;
using namespace std::string_literals;
using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;

namespace {

const std::string kSequence =
    "qpt 1\nname moves\nn 2\nm 1\nHdense 2\n2\n1 3\ng 1\n1 5\nA 2\n0 0 1\n0 1 -1\nrows 1\n0 "
    "1\ncols 2\n0 1\n0 2\n"
    "frames 3\nshift 1\n"
    "frame 0\nstatus optimal\nobjective 1\n"
    "frame 1\ng 1\n0 -1\nrows 1\n-1 2\nstatus infeasible\n"
    "frame 2\ncols 2\n0 0\n0 0\nobjective -4\nend\n";

std::string refusal(const std::string& text) { return refusal_of(parse_qpt(text, "f.qpt")); }

std::string with(const std::string& from, const std::string& to) {
  return replaced(kSingleProgram, from, to);
}

/// Accepted, or refused with a message that names the line.
void check_judged(const std::string& text) {
  const std::string message = refusal(text);
  if (message != "accepted") check_refusal(message, "f.qpt", text);
}

}  // namespace

TEST_CASE("QPT: every section of a single program is read", "[qpt]") {
  const QpProblem p = value_of(parse_qpt(kSingleProgram, "f.qpt"));
  check_same(p, single_program());
  CHECK(p.n() == 3);
  CHECK(p.m() == 2);
  CHECK_FALSE(p.maximise);
}

TEST_CASE("QPT: frames take omitted parts from the base program", "[qpt]") {
  check_same(value_of(parse_qpt(kSequence, "f.qpt")), program_sequence());
}

TEST_CASE("QPT: certificates and crossed bounds are read; matrices and rows may be omitted",
          "[qpt]") {
  const QpProblem p =
      value_of(parse_qpt("qpt 1 n 2 m 1 A 1 0 0 1 rows 1 3 2 cols 2 0 1 5 inf status infeasible "
                         "farkas_y 1 -1 farkas_z 2 1 0 end",
                         "f"));
  CHECK(p.H == Matrix::Zero(2, 2));
  CHECK(p.reference.farkas_y[0] == -1);
  CHECK(p.reference.farkas_z == (Vector(2) << 1, 0).finished());
  CHECK(p.rl[0] == 3);
  CHECK(p.ru[0] == 2);
  const QpProblem q =
      value_of(parse_qpt("qpt 1 n 2 cols 2 0 inf 1 0 status unbounded x 2 0 0 ray 2 1 0 end", "f"));
  CHECK(q.m() == 0);
  CHECK(q.A.cols() == 2);
  CHECK(q.reference.ray == (Vector(2) << 1, 0).finished());
  CHECK(q.lb[1] == 1);
  CHECK(q.ub[1] == 0);
}

TEST_CASE("QPT: errors are named with file, line and value", "[qpt]") {
  CHECK(refusal("") == "f.qpt:1: the file ends in section 'the head', without 'end'");
  CHECK(refusal("NAME x\n") == "f.qpt:1: 'NAME' found, expected qpt");
  CHECK(refusal("qpt 2\n") == "f.qpt:1: qpt: version 2 is unknown, expected 1");
  CHECK(refusal(with("g 2", "h 2")) == "f.qpt:11: 'h' is not a section");
  CHECK(refusal(with("0 2 -0.5", "0 3 -0.5")) == "f.qpt:8: H: column: '3' is not within 0 to 2");
  CHECK(refusal(with("0 2 -0.5", "-1 2 -0.5")) == "f.qpt:8: H: row: '-1' is not within 0 to 2");
  CHECK(refusal(with("0 2 -0.5", "2 0 -0.5")) ==
        "f.qpt:8: H(2,0) lies below the diagonal, expected the upper triangle");
  CHECK(refusal(with("0 2 -0.5", "0 0 -0.5")) == "f.qpt:8: H(0,0) is given twice");
  CHECK(refusal(with("0 2 -0.5", "0 2 nan")) == "f.qpt:8: H(0,2): 'nan' is not finite");
  CHECK(refusal(with("0 2 -0.5", "0 2 inf")) == "f.qpt:8: H(0,2): 'inf' is not finite");
  CHECK(refusal(with("0 2 -0.5", "0 2 1e999")) ==
        "f.qpt:8: H(0,2): '1e999' is out of the range of a double");
  CHECK(refusal(with("0 2 -0.5", "0 2.5 1")) == "f.qpt:8: H: column: '2.5' is not a whole number");
  CHECK(refusal(with("H 4", "H 5")) == "f.qpt:11: H: row: 'g' is not a whole number");
  CHECK(refusal(with("H 4", "H 3")) == "f.qpt:10: '2' is not a section");
  CHECK(refusal(with("H 4", "H 7")) == "f.qpt:6: H: '7' is not within 0 to 6");
  CHECK(refusal(with("H 4", "H -1")) == "f.qpt:6: H: '-1' is not within 0 to 6");
  CHECK(refusal(with("H 4", "H 99999999999999999999")) ==
        "f.qpt:6: H: '99999999999999999999' is not within 0 to 6");
  CHECK(refusal(with("g 2", "g 4")) == "f.qpt:11: g: '4' is not within 0 to 3");
  CHECK(refusal(with("2 1e-3", "0 1")) == "f.qpt:13: g(0) is given twice");
  CHECK(refusal(with("2 1e-3", "2 x")) == "f.qpt:13: g(2): 'x' is not a number");
  CHECK(refusal(with("rows 2", "rows 3")) == "f.qpt:18: rows: '3' is not 2");
  CHECK(refusal(with("-inf 4", "inf 4")) == "f.qpt:19: rows: 0: lower bound inf");
  CHECK(refusal(with("-inf 4", "nan 4")) == "f.qpt:19: rows: 0: 'nan' is not finite");
  CHECK(refusal(with("-1 2.5", "-1 -1e30")) == "f.qpt:24: cols: 2: upper bound -1e+30");
  CHECK(refusal(with("optimal", "fine")) ==
        "f.qpt:25: status: 'fine' is not optimal, infeasible or unbounded");
  CHECK(refusal(with("unique 1", "unique 2")) == "f.qpt:27: unique: '2' is not within 0 to 1");
  CHECK(refusal(with("x 3", "x 2")) == "f.qpt:28: x: '2' is not 3");
  CHECK(refusal(with("end", "end 7")) == "f.qpt:34: '7' after 'end'");
  CHECK(refusal(with("end", "z 3")) == "f.qpt:34: 'z' is given twice");
  CHECK(refusal(with("end", "")) == "f.qpt:35: the file ends in section 'z', without 'end'");
  CHECK(refusal(with("n 3", "n 0")) == "f.qpt:3: n: '0' is not within 1 to 20000");
  CHECK(refusal(with("n 3", "n 2000000000")) ==
        "f.qpt:3: n: '2000000000' is not within 1 to 20000");
  CHECK(refusal(with("n 3\n", "")) == "f.qpt:5: 'H' comes before 'n'");
  CHECK(refusal("qpt 1 n 3 cols 3 0 1 0 1 0 1 m 2 end") ==
        "f.qpt:1: 'm' comes after what it sizes");
  CHECK(refusal("qpt 1\nn 20000\nm 0\nH 0\n")
            .find("f.qpt:4: 20000 unknowns and 0 rows are too many") == 0);
  CHECK(refusal("qpt 1\nn 1\nend") == "f.qpt:3: 'cols' is missing before 'end'");
  CHECK(refusal("qpt 1 n 1 m 1 cols 1 0 1 end") == "f.qpt:1: 'rows' is missing before 'end'");
  CHECK(refusal("qpt 1 n 1 cols 1 0 1 A 1 0 0 1 end") == "f.qpt:1: A: '1' is not 0");
}

TEST_CASE("QPT: errors in a sequence are named", "[qpt]") {
  const auto changed = [](const std::string& from, const std::string& to) {
    return refusal(replaced(kSequence, from, to));
  };
  CHECK(changed("frames 3", "frames 4") == "f.qpt:34: expected 4 frames, found 3");
  CHECK(changed("frames 3", "frames 2") == "f.qpt:29: a frame after the last of 2");
  CHECK(changed("frames 3", "frames 99999999999") ==
        "f.qpt:18: frames: '99999999999' is not within 1 to 67108864");
  CHECK(changed("frame 1", "frame 2") == "f.qpt:23: frame: '2' is not 1");
  CHECK(changed("shift 1", "shift 3") == "f.qpt:19: shift: '3' is not within 0 to 2");
  CHECK(changed("frames 3\n", "") == "f.qpt:19: 'frame' comes before 'frames'");
  CHECK(changed("frame 1\ng 1", "frame 1\nH 1") == "f.qpt:24: 'H' does not belong into a frame");
  CHECK(changed("frame 1\ng 1", "frame 1\nn 1") == "f.qpt:24: 'n' does not belong into a frame");
  CHECK(changed("frame 0\n", "frame 0\nx 2 0 0\n") == "f.qpt:21: 'x' does not belong into a frame");
}

TEST_CASE("QPT: frames that need too much memory are refused", "[qpt]") {
  std::string text = "qpt 1 n 5000 cols 5000";
  for (int i = 0; i < 5000; ++i) text += " 0 1";
  text += " frames 1000000";
  for (int t = 0; t < 10000; ++t) text += "\nframe " + std::to_string(t);
  CHECK(refusal(text).find("numbers in frames") != std::string::npos);
}

TEST_CASE("QPT: a solution has answers with any status and no data", "[qpt]") {
  const QpSolution one = value_of(parse_qpt_solution(
      "qpt 1 name p n 2 m 1 status time_limit objective -0.5 x 2 1 2 y 1 3 z 2 4 5 end", "s.txt"));
  CHECK(one.name == "p");
  CHECK(one.n == 2);
  CHECK(one.m == 1);
  CHECK(one.reference.status == "time_limit");
  CHECK(one.reference.objective == -0.5);
  CHECK(one.reference.x == Vector(Vector::LinSpaced(2, 1, 2)));
  CHECK(one.reference.y[0] == 3);
  CHECK(one.reference.z == Vector(Vector::LinSpaced(2, 4, 5)));
  CHECK(one.frames.empty());
  const QpSolution moves = value_of(
      parse_qpt_solution("qpt 1 n 1 frames 2 frame 0 status solved x 1 3 frame 1 end", "s.txt"));
  REQUIRE(moves.frames.size() == 2);
  CHECK(moves.frames[0].status == "solved");
  CHECK(moves.frames[0].x[0] == 3);
  CHECK(moves.frames[1].status.empty());
  CHECK(moves.frames[1].x.size() == 0);
  const auto refused = [](const std::string& text) {
    return refusal_of(parse_qpt_solution(text, "s.txt"));
  };
  CHECK(refused(kSingleProgram) == "s.txt:6: 'H' does not belong into a solution");
  CHECK(refused("qpt 1 n 2\ncols 2 0 1 0 1 end") ==
        "s.txt:2: 'cols' does not belong into a solution");
  CHECK(refused("qpt 1 n 2\nx 2 1 inf end") == "s.txt:2: x(1): 'inf' is not finite");
  CHECK(refused("qpt 1 n 2 frames 1 end") == "s.txt:1: expected 1 frames, found 0");
  CHECK(refused("qpt 1 end") == "s.txt:1: 'end' comes before 'n'");
}

TEST_CASE("QPT: the reader refuses or accepts truncated and damaged texts without crashing",
          "[qpt]") {
  const std::string bytes = "0123456789-+.einfNaH g\n\t\0\xff"s;
  for (const std::string& text : {kSingleProgram, kSequence}) {
    for_each_prefix(text, [](const std::string& prefix) {
      check_judged(prefix);
      CHECK(refusal(prefix) != "accepted");
    });
    for_each_spoilt(text, bytes, 7, 20000, check_judged);
  }
}

TEST_CASE("QPT: the reference programs have the sizes listed in their index", "[qpt]") {
  const std::string folder = shared_path("data/qp");
  if (folder.empty()) {
    WARN("no shared data: the reference programs are not read");
    return;
  }
  int read = 0;
  for (const std::string set : {"maros_meszaros", "synthetic"}) {
    const std::string index = value_of(clothctl::read_file(folder + "/" + set + "/index.csv"));
    std::istringstream lines(index);
    std::string line;
    std::getline(lines, line);
    std::vector<std::string_view> head_cells;
    const std::string head = line;
    clothctl::detail::split_cells(head, head_cells);
    while (std::getline(lines, line)) {
      std::vector<std::string_view> cells;
      clothctl::detail::split_cells(line, cells);
      REQUIRE(cells.size() == head_cells.size());
      std::map<std::string_view, std::string> row;
      for (std::size_t c = 0; c < cells.size(); ++c) row[head_cells[c]] = std::string(cells[c]);
      INFO(row["name"]);
      const QpProblem p =
          value_of(clothctl::read_qpt(folder + "/" + set + "/" + row["name"] + ".qpt"));
      CHECK(p.name == row["name"]);
      CHECK(p.n() == std::stol(row["n"]));
      CHECK(p.m() == std::stol(row["m"]));
      CHECK((p.H.array() != 0).count() == std::stol(row["nnzH"]));
      CHECK((p.A.array() != 0).count() == std::stol(row["nnzA"]));
      CHECK(p.H == p.H.transpose());
      if (set == "synthetic") CHECK(static_cast<long>(p.frames.size()) == std::stol(row["frames"]));
      if (set == "synthetic" && p.frames.empty()) CHECK(p.reference.status == row["status"]);
      ++read;
    }
  }
  CHECK(read == 144);
}
