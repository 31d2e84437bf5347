// QPS: every section and convention compared with matrices written by hand, both forms, refusals,
// and random text.

#include "clothctl/io/qps.hpp"

#include <string>

#include "clothctl/io/qpt.hpp"
#include "clothctl/io/qpt_writer.hpp"
#include "io/qpt_programs.hpp"
#include "io/spoilt_text.hpp"
#include "support/catch.hpp"
#include "support/reading.hpp"

using clothctl::parse_qps;
using clothctl::QpProblem;
using clothctl::QpsForm;
using namespace clothctl_test;
using namespace std::string_literals;
using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;

namespace {

// Every section. Seven unknowns for the seven kinds of bounds.
const std::string kFree =
    "* a comment\n"
    "NAME every section\n"
    "OBJSENSE\n    MIN\n"
    "ROWS\n N cost\n L most\n G least\n E same\n N spare\n L band\n G wide\n E above\n E below\n"
    "COLUMNS\n"
    " a cost 1.5 most 1\n a least 2\n"
    " b same 1 band -1\n b spare 9\n"
    " c wide 1D+1 above 1\n"
    " d below 1 cost -2.0d0\n"
    " e most 1\n f most 1\n g most 1\n"
    "RHS\n rhs cost 4 most 10\n rhs least 1 same 2\n rhs band 3 wide 4\n rhs above 5 below 6\n "
    "other most 99\n"
    "RANGES\n range band -2 wide 3\n range above 1 below -1\n"
    "BOUNDS\n UP bnd a 4\n LO bnd b -1\n UP bnd b 1\n FX bnd c 2.5\n FR bnd d\n MI bnd e\n UP bnd "
    "f -3\n PL bnd g\n UP two a "
    "1\n"
    "QUADOBJ\n a a 2\n a b -1\n b b 3\n d c 0.5\n"
    "ENDATA\n";

std::string refusal(const std::string& text, QpsForm form = QpsForm::Free) {
  return refusal_of(parse_qps(text, "f.qps", form));
}

std::string with(const std::string& from, const std::string& to) {
  return replaced(kFree, from, to);
}

QpProblem parsed(const std::string& text, QpsForm form = QpsForm::Detect) {
  return value_of(parse_qps(text, "f.qps", form));
}

/// A program of unknowns x, y (0 ≤) and one row, with additional lines.
std::string small(const std::string& bounds, const std::string& rest = "") {
  return "NAME\nROWS\n N o\n L r\nCOLUMNS\n x o 1 r 1\n y o 1 r 1\nRHS\n r 1\n" + bounds + rest +
         "ENDATA\n";
}

}  // namespace

TEST_CASE("QPS: every section is read by the format's conventions", "[qps]") {
  const QpProblem p = parsed(kFree, QpsForm::Free);
  CHECK(p.name == "every section");
  CHECK(p.column_names == std::vector<std::string>{"a", "b", "c", "d", "e", "f", "g"});
  CHECK(p.row_names ==
        std::vector<std::string>{"most", "least", "same", "band", "wide", "above", "below"});
  CHECK(p.r == -4);
  CHECK(p.g == (Vector(7) << 1.5, 0, 0, -2, 0, 0, 0).finished());
  Matrix A = Matrix::Zero(7, 7);
  A(0, 0) = A(0, 4) = A(0, 5) = A(0, 6) = 1;
  A(1, 0) = 2;
  A(2, 1) = 1;
  A(3, 1) = -1;
  A(4, 2) = 10;
  A(5, 2) = 1;
  A(6, 3) = 1;
  CHECK(p.A == A);
  CHECK(p.rl == (Vector(7) << -kInfinity, 1, 2, 1, 4, 5, 5).finished());
  CHECK(p.ru == (Vector(7) << 10, kInfinity, 2, 3, 7, 6, 6).finished());
  CHECK(p.lb == (Vector(7) << 0, -1, 2.5, -kInfinity, -kInfinity, -kInfinity, 0).finished());
  CHECK(p.ub == (Vector(7) << 4, 1, 2.5, kInfinity, kInfinity, -3, kInfinity).finished());
  Matrix H = Matrix::Zero(7, 7);
  H(0, 0) = 2;
  H(0, 1) = H(1, 0) = -1;
  H(1, 1) = 3;
  H(2, 3) = H(3, 2) = 0.5;
  CHECK(p.H == H);
}

TEST_CASE("QPS: QMATRIX gives both triangles and QSECTION one", "[qps]") {
  const QpProblem both = parsed(small("", "QMATRIX\n x x 8\n x y 2\n y x 2\n y y 10\n"));
  const QpProblem one = parsed(small("", "QSECTION o\n x x 8\n x y 2\n y y 10\n"));
  CHECK(both.H == (Matrix(2, 2) << 8, 2, 2, 10).finished());
  CHECK(one.H == both.H);
  CHECK(refusal(small("", "QMATRIX\n x x 8\n x y 2\n")) ==
        "f.qps:12: QMATRIX: the entry of 'x' and 'y' differs from that of 'y' and 'x'");
  CHECK(refusal(small("", "QUADOBJ\n x y 2\n y x 2\n")) ==
        "f.qps:12: column 'y': the entry of 'x' is given twice");
  CHECK(refusal(small("", "QUADOBJ\n x y 2\nQMATRIX\n y x 2\n")) ==
        "f.qps:12: QMATRIX after QUADOBJ");
}

TEST_CASE("QPS: a maximum is the minimum of the negated objective", "[qps]") {
  for (const std::string sense : {"OBJSENSE MAX\n", "OBJSENSE\n  MAXIMIZE\n", "objsense max\n"}) {
    const QpProblem p = parsed(
        sense + "ROWS\n N o\nCOLUMNS\n x o 3\n y o 0\nRHS\n o 7\nQUADOBJ\n x x -2\nENDATA\n");
    CHECK(p.maximise);
    CHECK(p.m() == 0);
    CHECK(p.g == (Vector(2) << -3, 0).finished());
    CHECK(p.r == 7);
    CHECK(p.H(0, 0) == 2);
  }
  CHECK(refusal("OBJSENSE UP\n") == "f.qps:1: OBJSENSE: 'UP' is not MIN or MAX");
}

TEST_CASE("QPS: bounds follow the rules for sides, sets, order and negative upper bounds",
          "[qps]") {
  const auto bounds = [](const std::string& lines) {
    const QpProblem p = parsed(small("BOUNDS\n" + lines));
    return std::pair<double, double>(p.lb[0], p.ub[0]);
  };
  using Pair = std::pair<double, double>;
  CHECK(bounds(" UP x 3\n") == Pair(0, 3));
  CHECK(bounds(" UP s x 0\n") == Pair(0, 0));
  CHECK(bounds(" UP s x -2\n") == Pair(-kInfinity, -2));
  CHECK(bounds(" LO s x -5\n UP s x -2\n") == Pair(-5, -2));
  CHECK(bounds(" UP s x -2\n LO s x -5\n") == Pair(-5, -2));
  CHECK(bounds(" UP s x -2\n LO s x 0\n") == Pair(0, -2));  // infeasible, as the file says
  CHECK(bounds(" MI s x\n UP s x 4\n") == Pair(-kInfinity, 4));
  CHECK(bounds(" FR x\n") == Pair(-kInfinity, kInfinity));
  CHECK(bounds(" FR s x 0\n LO s x 1\n") == Pair(1, kInfinity));
  CHECK(bounds(" FX s x -7\n") == Pair(-7, -7));
  CHECK(bounds(" UP s x 3\n PL s x\n") == Pair(0, kInfinity));
  CHECK(bounds(" LO s x -Inf\n UP s x 1e30\n") == Pair(-kInfinity, 1e30));
  CHECK(bounds(" UP s x 3\n UP t x 2\n") == Pair(0, 3));
  CHECK(refusal(small("BOUNDS\n BV s x\n")) ==
        "f.qps:11: BOUNDS: type 'BV' asks for an integer unknown, which is not read");
  CHECK(refusal(small("BOUNDS\n XX s x 1\n")) == "f.qps:11: BOUNDS: type 'XX' is unknown");
  CHECK(refusal(small("BOUNDS\n UP s x nan\n")) == "f.qps:11: BOUNDS: 'x': 'nan' is not finite");
  CHECK(refusal(small("BOUNDS\n UP s x -inf\n")) == "f.qps:11: BOUNDS: 'x': upper bound -inf");
  CHECK(refusal(small("BOUNDS\n LO s x inf\n")) == "f.qps:11: BOUNDS: 'x': lower bound inf");
  CHECK(refusal(small("BOUNDS\n FX s x inf\n")) == "f.qps:11: BOUNDS: 'x': 'inf' is not finite");
  CHECK(refusal(small("BOUNDS\n UP s w 1\n")) == "f.qps:11: BOUNDS: 'w' is not a column");
}

TEST_CASE("QPS: right-hand sides and ranges give the rows' bounds", "[qps]") {
  for (const std::string type : {"L", "G", "E"}) {
    for (const double range : {2.0, -2.0}) {
      const QpProblem p =
          parsed("ROWS\n N o\n " + type + " r\nCOLUMNS\n x r 1\nRHS\n r 5\nRANGES\n r " +
                 std::to_string(range) + "\nENDATA\n");
      const bool below = type == "L" || (type == "E" && range < 0);
      CHECK(p.rl[0] == (below ? 3 : 5));
      CHECK(p.ru[0] == (below ? 5 : 7));
    }
  }
  const QpProblem none =
      parsed("ROWS\n E r\nCOLUMNS\n x r 1\nRANGES\n r 0\nENDATA\n");  // neither objective nor RHS
  CHECK(none.rl[0] == 0);
  CHECK(none.ru[0] == 0);
  CHECK(none.g[0] == 0);
  CHECK(refusal(with("range band -2", "range cost -2")) ==
        "f.qps:32: RANGES: 'cost' is the objective");
  CHECK(refusal(with("rhs band 3", "rhs most 3")) == "f.qps:28: RHS: 'most' is given twice");
  CHECK(refusal(with("rhs least 1", "rhs least 1e30")) ==
        "f.qps:27: row 'least': lower bound 1e+30");
}

TEST_CASE("QPS: fixed form allows names with blanks and empty set names", "[qps]") {
  const std::string fixed =
      "NAME          MY NAME\n"
      "ROWS\n"
      " N  MY COST\n"
      " L  ROW ONE\n"
      "COLUMNS\n"
      "    COL A     MY COST            1.5   ROW ONE            2.0\n"
      "    COL B     ROW ONE           -1.0\n"
      "RHS\n"
      "              ROW ONE            4.0   MY COST            3.0\n"
      "BOUNDS\n"
      " UP BND SET   COL A              5.0\n"
      " FR BND SET   COL B\n"
      "QUADOBJ\n"
      "    COL A     COL B              0.5\n"
      "ENDATA\n";
  for (const QpsForm form : {QpsForm::Fixed, QpsForm::Detect}) {
    const QpProblem p = parsed(fixed, form);
    CHECK(p.name == "MY NAME");
    CHECK(p.column_names == std::vector<std::string>{"COL A", "COL B"});
    CHECK(p.g == (Vector(2) << 1.5, 0).finished());
    CHECK(p.A == (Matrix(1, 2) << 2, -1).finished());
    CHECK(p.ru[0] == 4);
    CHECK(p.r == -3);
    CHECK(p.lb == (Vector(2) << 0, -kInfinity).finished());
    CHECK(p.ub == (Vector(2) << 5, kInfinity).finished());
    CHECK(p.H(0, 1) == 0.5);
    CHECK(p.H(1, 0) == 0.5);
  }
  CHECK(refusal(fixed) == "f.qps:3: ROWS: expected a type and a name, found 3 fields");
  const std::string late = replaced(fixed, "  MY COST            3.0", "12MY COST            3.0");
  CHECK(refusal(late, QpsForm::Fixed)
            .find("f.qps:9: RHS: '12' stands between the columns of the fields") == 0);
}

TEST_CASE("QPS: errors are named with file, line and value", "[qps]") {
  CHECK(refusal("") == "f.qps:1: the file ends without ENDATA");
  CHECK(refusal("NAME x\nENDATA\n") == "f.qps:2: no column before ENDATA");
  CHECK(refusal(" x y 1\n") == "f.qps:1: 'x y 1' stands in no section");
  CHECK(refusal("ROOMS\n") == "f.qps:1: 'ROOMS' is not a section that is read");
  CHECK(refusal("ROWS r\n") == "f.qps:1: ROWS: 'r' stands in the section's first line");
  CHECK(refusal(with("ENDATA\n", "")) == "f.qps:49: the file ends without ENDATA");
  CHECK(refusal(with(" L most", " M most")) == "f.qps:7: ROWS: 'M' is not N, L, G or E");
  CHECK(refusal(with(" G least", " G most")) == "f.qps:8: ROWS: 'most' is given twice");
  CHECK(refusal(with("a least 2", "a last 2")) == "f.qps:17: COLUMNS: 'last' is not a row");
  CHECK(refusal(with("a least 2", "a most 2")) ==
        "f.qps:17: column 'a': the entry of 'most' is given twice");
  CHECK(refusal(with("a least 2", "a cost 2")) ==
        "f.qps:17: column 'a': the entry of 'the objective' is given twice");
  CHECK(refusal(with("a least 2", "a least 2x")) ==
        "f.qps:17: COLUMNS: 'least': '2x' is not a number");
  CHECK(refusal(with("a least 2", "m 'MARKER' 'INTORG'")) ==
        "f.qps:17: integer unknowns ('MARKER') are not read");
  CHECK(refusal(with(" b b 3", " b z 3")) == "f.qps:47: QUADOBJ: 'z' is not a column");
  CHECK(refusal(with(" b b 3", " b a 3")) ==
        "f.qps:47: column 'b': the entry of 'a' is given twice");
  CHECK(refusal(with(" b b 3", "ROWS")) == "f.qps:47: ROWS is given twice");
}

TEST_CASE(
    "QPS: a missing end is reported at the last line, and a final line break begins another line",
    "[qps]") {
  const std::string what = "the file ends without ENDATA";
  CHECK(refusal("ROWS") == "f.qps:1: " + what);
  CHECK(refusal("ROWS\n N o") == "f.qps:2: " + what);
  CHECK(refusal("ROWS\n N o\n") == "f.qps:3: " + what);
  CHECK(refusal("ROWS\n N o\n\n* no end") == "f.qps:4: " + what);
  CHECK(refusal("\n\n  ") == "f.qps:3: " + what);
  CHECK(parsed("ROWS\n N o\nCOLUMNS\n x o 1\nENDATA").g[0] == 1);
}

TEST_CASE("QPS: a section's name is shown short and printable", "[qps]") {
  const std::string longest(100000, 'A');
  const std::string unknown =
      "f.qps:1: '" + longest.substr(0, 40) + "…' is not a section that is read";
  for (const std::string rest : {"", " b", " b c d e f g"})
    CHECK(refusal(longest + rest + "\n") == unknown);
  CHECK(refusal("NA\x1bME x\n") == "f.qps:1: 'NA?ME' is not a section that is read");
  CHECK(refusal("\x7f\n") == "f.qps:1: '?' is not a section that is read");
  CHECK(refusal("rooms r\n") == "f.qps:1: 'rooms' is not a section that is read");
  CHECK(refusal("rows " + longest + "\n") ==
        "f.qps:1: ROWS: '" + longest.substr(0, 40) + "…' stands in the section's first line");
}

TEST_CASE("QPS: a refused number is shown as it stands in the file", "[qps]") {
  const auto refused = [](const std::string& number) {
    return refusal(with("a least 2", "a least " + number));
  };
  const std::string at = "f.qps:17: COLUMNS: 'least': ";
  CHECK(refused("ABCD") == at + "'ABCD' is not a number");
  CHECK(refused("1D") == at + "'1D' is not a number");
  CHECK(refused("1D999") == at + "'1D999' is out of the range of a double");
  CHECK(refused("-1d+999") == at + "'-1d+999' is out of the range of a double");
  CHECK(refused("NaN") == at + "'NaN' is not finite");
  CHECK(refused("+Infinity") == at + "'+Infinity' is not finite");
  CHECK(refused("DDD\x1b") == at + "'DDD?' is not a number");
  CHECK(refusal("ROWS\n N  o\nCOLUMNS\n    x         o\n", QpsForm::Fixed) ==
        "f.qps:4: COLUMNS: 'o': found an empty cell, expected a number");
}

TEST_CASE("QPS: superfluous fields are refused in both forms", "[qps]") {
  const std::string fixed =
      "ROWS\n N  o         @\n L  r\nCOLUMNS\n    x         o                  1.0\n"
      "BOUNDS\n UP bnd       x                  5.0   #\nENDATA\n";
  const auto filled = [&](const std::string& row, const std::string& bound) {
    return replaced(replaced(fixed, "@", row), "#", bound);
  };
  for (const QpsForm form : {QpsForm::Free, QpsForm::Fixed})
    CHECK(parsed(filled("", ""), form).ub[0] == 5);
  const std::string at_row = "f.qps:2: ROWS: ", at_bound = "f.qps:7: BOUNDS: ";
  CHECK(refusal(filled("r", ""), QpsForm::Fixed) ==
        at_row + "'r' stands in columns 15 to 22, expected nothing there");
  CHECK(refusal(filled("", "y"), QpsForm::Fixed) ==
        at_bound + "'y' stands in columns 40 to 47, expected nothing there");
  CHECK(refusal(filled("r", "")) == at_row + "expected a type and a name, found 3 fields");
  CHECK(refusal(filled("", "y")) ==
        at_bound + "expected a type, a set, a column and a value, found 5 fields");
  CHECK(refusal(filled("r", ""), QpsForm::Detect) != "accepted");
  CHECK(refusal(filled("", "y"), QpsForm::Detect) != "accepted");
}

TEST_CASE("QPS: a QPS program written as QPT is the same program", "[qps]") {
  QpProblem p = parsed(kFree);
  p.name = "every_section";
  check_same(value_of(clothctl::parse_qpt(clothctl::qpt_text(p), "f.qpt")), p);
}

TEST_CASE("QPS: the reader refuses or accepts truncated and damaged texts without crashing",
          "[qps]") {
  const auto judged = [](const std::string& text) {
    for (const QpsForm form : {QpsForm::Detect, QpsForm::Fixed}) {
      const std::string message = refusal(text, form);
      if (message != "accepted") check_refusal(message, "f.qps", text);
    }
  };
  for_each_prefix(kFree, [&](const std::string& prefix) {
    judged(prefix);
    CHECK(refusal(prefix) != "accepted");
  });
  for_each_spoilt(kFree, "0123456789-+.einfNaUPH *\n\t\0\xff"s, 11, 15000, judged);
}
