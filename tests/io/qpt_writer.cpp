// Programs and solutions as QPT text: the written words, omitted zeros and shared parts, and exact
// round trips.

#include "clothctl/io/qpt_writer.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <string>

#include "clothctl/io/qpt.hpp"
#include "io/qpt_programs.hpp"
#include "support/catch.hpp"
#include "support/reading.hpp"

using clothctl::Index;
using clothctl::parse_qpt;
using clothctl::parse_qpt_solution;
using clothctl::QpProblem;
using clothctl::QpSequenceFrame;
using clothctl::QpSolution;
using clothctl::qpt_solution_text;
using clothctl::qpt_text;
using namespace clothctl_test;
using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;

namespace {

/// Places of a frame's bounds.
constexpr Vector QpSequenceFrame::*kSides[] = {&QpSequenceFrame::rl, &QpSequenceFrame::ru,
                                               &QpSequenceFrame::lb, &QpSequenceFrame::ub};

QpProblem read_back(const QpProblem& p) { return value_of(parse_qpt(qpt_text(p), "f.qpt")); }

/// Writes, reads and compares.
void check_reads_back(const QpProblem& a) { check_same(a, read_back(a)); }
void check_reads_back(const QpSolution& a) {
  check_same(a, value_of(parse_qpt_solution(qpt_solution_text(a), "s.txt")));
}

QpSolution solution() {
  std::mt19937 engine(3);
  std::normal_distribution<double> normal;
  QpSolution out{"drawn", 4, 2, {}, {}};
  out.reference.status = "iteration_limit";
  out.reference.objective = normal(engine) * 1e-200;
  for (Vector* v :
       {&out.reference.x, &out.reference.z, &out.reference.farkas_z, &out.reference.ray})
    *v = Vector::NullaryExpr(4, [&] { return normal(engine); });
  for (Vector* v : {&out.reference.y, &out.reference.farkas_y})
    *v = Vector::NullaryExpr(2, [&] { return 1e9 * normal(engine); });
  return out;
}

}  // namespace

TEST_CASE("a program is written section by section without zeros", "[io]") {
  CHECK(qpt_text(single_program()) == replaced(kSingleProgram, "1e-3", "0.001"));
}

TEST_CASE("a sequence writes for each frame its gradient and the differences from the base",
          "[io]") {
  CHECK(qpt_text(program_sequence()) ==
        "qpt 1\nname moves\nn 2\nm 1\nr 0\nH 3\n0 0 2\n0 1 1\n1 1 3\ng 1\n1 5\nA 2\n0 0 1\n0 1 "
        "-1\nrows 1\n0 1\n"
        "cols 2\n0 1\n0 2\nframes 3\nshift 1\n"
        "frame 0\ng 1\n1 5\nstatus optimal\nobjective 1\n"
        "frame 1\ng 1\n0 -1\nrows 1\n-1 2\nstatus infeasible\n"
        "frame 2\ng 1\n1 5\ncols 2\n0 0\n0 0\nobjective -4\nend\n");
}

TEST_CASE("each bound of a frame that differs is written", "[io]") {
  for (Vector QpSequenceFrame::*side : kSides) {
    QpProblem p = program_sequence();
    p.frames.resize(1);
    (p.frames[0].*side)[0] = 0.25;
    check_reads_back(p);
  }
}

TEST_CASE("the smallest program has one unknown and its bounds", "[io]") {
  QpProblem p;
  p.H.setZero(1, 1);
  p.g.setZero(1);
  p.A.setZero(0, 1);
  p.lb = p.ub = Vector::Constant(1, 3);
  CHECK(qpt_text(p) ==
        "qpt 1\nname unnamed\nn 1\nm 0\nr 0\nH 0\ng 0\nA 0\nrows 0\ncols 1\n3 3\nend\n");
  p.name = "unnamed";
  check_reads_back(p);
}

TEST_CASE("a certificate is written with its status", "[io]") {
  QpSolution s{"p", 2, 1, {}, {}};
  s.reference.status = "infeasible";
  s.reference.farkas_y = Vector::Constant(1, -1);
  s.reference.farkas_z = (Vector(2) << 1, 0).finished();
  CHECK(qpt_solution_text(s) ==
        "qpt 1\nname p\nn 2\nm 1\nstatus infeasible\nfarkas_y 1\n-1\nfarkas_z 2\n1 0\nend\n");
  s.reference = {};
  s.reference.status = "unbounded";
  s.reference.unique = false;
  s.reference.x = Vector::Zero(2);
  s.reference.ray = (Vector(2) << 0.5, -1).finished();
  CHECK(qpt_solution_text(s) ==
        "qpt 1\nname p\nn 2\nm 1\nstatus unbounded\nunique 0\nx 2\n0 0\nray 2\n0.5 -1\nend\n");
}

TEST_CASE("the solution of a sequence has the answer of each frame", "[io]") {
  QpSolution s{"p", 1, 0, {}, {}};
  s.frames.resize(3);
  s.frames[0].status = "solved";
  s.frames[0].objective = 0.5;
  s.frames[2].x = Vector::Ones(1);
  CHECK(qpt_solution_text(s) ==
        "qpt 1\nname p\nn 1\nm 0\nframes 3\nframe 0\nstatus solved\nobjective 0.5\nframe 1\nframe "
        "2\nx 1\n1\nend\n");
}

TEST_CASE("white space in a name becomes an underscore, and an empty name is omitted", "[io]") {
  const auto written = [](const std::string& name) {
    const std::string text = qpt_solution_text({name, 1, 0, {}, {}});
    REQUIRE(text.rfind("qpt 1\nname ", 0) == 0);
    return text.substr(11, text.find('\n', 11) - 11);
  };
  CHECK(written("plain-name.1") == "plain-name.1");
  CHECK(written("a name\twith\nblanks\r\v\f") == "a_name_with_blanks___");
  CHECK(written(" ") == "_");
  CHECK(written("é") == "é");
  CHECK(written("") == "unnamed");
  CHECK(written("end") == "end");
  check_reads_back(QpSolution{"end", 1, 0, {}, {}});
}

TEST_CASE("written programs, sequences and solutions read back the same", "[io]") {
  check_reads_back(single_program());
  check_reads_back(program_sequence());
  check_reads_back(solution());
  QpSolution moves = solution();
  moves.frames = {moves.reference, {}, moves.reference};
  moves.reference = {};
  check_reads_back(moves);
}

TEST_CASE("a number that is not finite is written, and refused when read", "[io]") {
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), kInfinity, -kInfinity}) {
    const auto check_refused = [](const QpProblem& p, const std::string& place) {
      const std::string message = refusal_of(parse_qpt(qpt_text(p), "f"));
      INFO(message << ", expected: " << place);
      CHECK(message.find(": " + place) != std::string::npos);
    };
    QpProblem p = single_program();
    p.r = bad;
    check_refused(p, "r: ");
    for (Index i = 0; i < 3; ++i) {
      p = single_program();
      p.g[i] = bad;
      check_refused(p, "g(" + std::to_string(i) + "): ");
      for (Index j = 0; j < 3; ++j) {  // in either triangle
        p = single_program();
        p.H(i, j) = bad;
        check_refused(p, "H(" + std::to_string(std::min(i, j)) + "," +
                             std::to_string(std::max(i, j)) + "): ");
      }
      for (Index k = 0; k < 2; ++k) {
        p = single_program();
        p.A(k, i) = bad;
        check_refused(p, "A(" + std::to_string(k) + "," + std::to_string(i) + "): ");
      }
    }
    p = single_program();
    p.reference.x[1] = bad;
    check_refused(p, "x(1): ");
    p = single_program();
    p.reference.objective = bad;
    check_refused(p, "objective: ");
    p = program_sequence();
    p.frames[1].g[0] = bad;
    check_refused(p, "g(0): ");
  }
  for (Vector QpSequenceFrame::*side : kSides) {
    QpProblem base = program_sequence(), moved = program_sequence();
    (base.*side)[0] = (moved.frames[2].*side)[0] = std::numeric_limits<double>::quiet_NaN();
    CHECK_FALSE(parse_qpt(qpt_text(base), "f").has_value());
    CHECK_FALSE(parse_qpt(qpt_text(moved), "f").has_value());
  }
}

TEST_CASE("no frame takes over an answer of the base program that it does not have", "[io]") {
  QpProblem p = program_sequence();
  p.reference.status = "optimal";
  p.reference.objective = 12;
  p.reference.unique = true;
  p.reference.x = (Vector(2) << 0, 1).finished();
  p.frames[1].reference.objective = 3;
  const auto frames_read_back = [&p] {
    QpProblem read = read_back(p);
    check_same(p.frames, read.frames);
    return read;
  };
  const QpProblem no_status = frames_read_back();  // the last frame has no status
  CHECK(no_status.reference.status.empty());
  CHECK(no_status.reference.objective == 12);
  CHECK(no_status.reference.unique == true);
  CHECK(no_status.reference.x == p.reference.x);
  p.frames[1].reference.objective.reset();
  CHECK_FALSE(frames_read_back().reference.objective.has_value());
  for (QpSequenceFrame& frame : p.frames)
    frame.reference = {"unbounded", -1.0, {}, {}, {}, {}, {}, {}, {}};
  check_reads_back(p);
  p.frames[2].reference.objective.reset();
  const QpProblem no_objective = frames_read_back();
  CHECK(no_objective.reference.status == "optimal");
  CHECK_FALSE(no_objective.reference.objective.has_value());
}

TEST_CASE("what the format cannot express is lost as documented", "[io]") {
  QpProblem p = single_program();
  p.maximise = true;
  p.shift = 2;
  p.name = "";
  p.row_names = {"r0", "r1"};
  p.column_names = {"a", "b", "c"};
  p.g[1] = -0.0;
  p.lb[0] = -0.0;
  QpProblem read = read_back(p);
  CHECK_FALSE(read.maximise);
  CHECK(read.shift == 0);
  CHECK(read.name == "unnamed");
  CHECK(read.row_names.empty());
  CHECK(read.column_names.empty());
  CHECK_FALSE(std::signbit(read.g[1]));
  CHECK(std::signbit(read.lb[0]));
  p = program_sequence();
  p.frames[0].reference.unique = true;
  p.frames[0].reference.x = Vector::Zero(2);
  p.frames[0].reference.z = Vector::Zero(2);
  read = read_back(p);
  CHECK(read.shift == 1);
  p.frames[0].reference = {"optimal", 1.0, {}, {}, {}, {}, {}, {}, {}};
  check_same(read.frames[0], p.frames[0]);
  p.frames[0].lb[0] = -0.0;  // the base program's is 0
  CHECK(std::signbit(read_back(p).frames[0].lb[0]));
}

TEST_CASE("any numbers read back bit for bit", "[io]") {
  std::mt19937 engine(5);
  const auto draw = [&] {
    std::uniform_real_distribution<double> digits(1, 10);
    std::uniform_int_distribution<int> kind(0, 5), exponent(-300, 300);
    if (kind(engine) == 0) return 0.0;
    if (kind(engine) == 0)
      return kind(engine) < 3 ? std::numeric_limits<double>::max()
                              : -std::numeric_limits<double>::min();
    return (kind(engine) < 3 ? -1 : 1) * digits(engine) * std::pow(10.0, exponent(engine));
  };
  for (int trial = 0; trial < 60; ++trial) {
    const Index n = 1 + trial % 7, m = trial % 5;
    QpProblem p;
    p.name = "trial_" + std::to_string(trial);
    p.r = draw();
    p.g = Vector::NullaryExpr(n, draw);
    p.A = Matrix::NullaryExpr(m, n, draw);
    p.H = Matrix::NullaryExpr(n, n, draw);
    p.H.triangularView<Eigen::StrictlyLower>() = p.H.transpose();
    // The reader accepts any lower bound except +inf, and any upper bound except -inf.
    const auto low = [&] { return trial % 3 == 0 ? -kInfinity : std::min(draw(), 1e20); };
    const auto high = [&] { return trial % 4 == 0 ? kInfinity : std::max(draw(), -1e20); };
    p.rl = Vector::NullaryExpr(m, low);
    p.ru = Vector::NullaryExpr(m, high);
    p.lb = Vector::NullaryExpr(n, low);
    p.ub = Vector::NullaryExpr(n, high);
    for (int t = 0; t < trial % 4; ++t) {
      p.frames.push_back(
          {Vector::NullaryExpr(n, draw), p.rl, Vector::NullaryExpr(m, high), p.lb, p.ub, {}});
      p.frames.back().reference.objective = draw();
    }
    if (!p.frames.empty()) p.shift = trial % (n + 1);
    check_reads_back(p);
  }
}
