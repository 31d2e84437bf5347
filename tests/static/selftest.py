#!/usr/bin/env python3
"""Tests the static checks: each must fail when its rule is broken.

Writes a small correct tree, breaks one thing, runs the check, and expects exit code 1 and a line
that names the place. The check must pass on the unbroken tree."""

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from house import arguments

HERE = Path(__file__).resolve().parent

# A small correct library with the structure of the real one.
TREE = {
    "include/clothctl/config.hpp": "#pragma once\n\n#define CLOTHCTL_VERSION_STRING \"0\"\n",
    "include/clothctl/clothctl.hpp": """#pragma once

#include "clothctl/concepts.hpp"
#include "clothctl/core.hpp"
#include "clothctl/math.hpp"
#include "clothctl/mesh.hpp"
#include "clothctl/qp.hpp"
""",
    "include/clothctl/concepts.hpp": '#pragma once\n\n#include "clothctl/concepts/paint.hpp"\n',
    "include/clothctl/core.hpp": '#pragma once\n\n#include "clothctl/core/number.hpp"\n',
    "include/clothctl/math.hpp": '#pragma once\n\n#include "clothctl/math/twice.hpp"\n',
    "include/clothctl/mesh.hpp": '#pragma once\n\n#include "clothctl/mesh/grid.hpp"\n',
    "include/clothctl/qp.hpp": '#pragma once\n\n#include "clothctl/qp/solver.hpp"\n',
    "include/clothctl/core/number.hpp": """#pragma once

#include <vector>

#include "clothctl/config.hpp"

namespace clothctl {

/// Names a colour.
enum class Colour {
  /// Red.
  Red,
  /// Blue.
  Blue
};

/// A list of numbers.
struct Numbers {
  /// The numbers.
  std::vector<double> values;
  /// How many there are.
  int size() const { return static_cast<int>(values.size()); }
};

}  // namespace clothctl
""",
    "include/clothctl/math/twice.hpp": """#pragma once

#include "clothctl/core/number.hpp"

namespace clothctl {

/// Twice the value.
template <class Scalar>
Scalar twice(Scalar x) {
  return Scalar(2) * x;
}

}  // namespace clothctl
""",
    "include/clothctl/concepts/paint.hpp": """#pragma once

#include <concepts>

#include "clothctl/core/number.hpp"

namespace clothctl {

/// How a type acts as a paint. The primary forwards to members of the same names.
template <class Paint>
struct paint_traits {
  /// How much is left.
  static int amount(const Paint& paint) requires requires { paint.amount(); }
  { return paint.amount(); }
  /// Whether it shines.
  static bool glossy(const Paint& paint) requires requires { paint.glossy(); }
  { return paint.glossy(); }
};

/// A paint.
///
/// Optional hooks: `glossy` (taken for false where it is missing).
template <class Paint>
concept AnyPaint = requires(const Paint& paint) {
  { paint_traits<Paint>::amount(paint) } -> std::convertible_to<int>;
};

}  // namespace clothctl
""",
    "include/clothctl/mesh/grid.hpp": """#pragma once

#include "clothctl/concepts/paint.hpp"
#include "clothctl/math/twice.hpp"

namespace clothctl {

/// Draws the lines of a grid.
template <AnyPaint Paint>
int draw_lines(const Paint& paint) {
  return twice(paint_traits<Paint>::amount(paint));
}

}  // namespace clothctl
""",
    "include/clothctl/qp/solver.hpp": '#pragma once\n\n#include "clothctl/math/twice.hpp"\n',
    "tests/core/number.cpp": '#include "clothctl/core/number.hpp"\n',
    "tests/math/twice.cpp": '#include "clothctl/math/twice.hpp"\n',
    "tests/mesh/grid.cpp": '#include "clothctl/mesh/grid.hpp"\n',
    "tests/qp/solver.cpp": '#include "clothctl/qp/solver.hpp"\n',
    "tests/concepts/paint.cpp": """#include "clothctl/concepts/paint.hpp"
#include "laws/paint_laws.hpp"
namespace other_engine {
struct Ink {};
}  // namespace other_engine
template <>
struct clothctl::paint_traits<other_engine::Ink> {
  static int amount(const other_engine::Ink&) { return 1; }
};
static_assert(clothctl::AnyPaint<other_engine::Ink> && !clothctl::AnyPaint<int>);
""",
    "tests/archetypes/paint.cpp": """#include "clothctl/concepts/paint.hpp"
struct PaintArchetype {
  int amount() const { return 0; }
};
static_assert(clothctl::AnyPaint<PaintArchetype>);
""",
    "tests/laws/paint_laws.hpp": """#pragma once
#include "clothctl/concepts/paint.hpp"
template <class Paint>
bool paint_laws(const Paint& paint) {
  static_assert(clothctl::AnyPaint<Paint>);
  return clothctl::paint_traits<Paint>::amount(paint) >= 0;
}
""",
    "tests/static/unit.cpp": '#include "clothctl/clothctl.hpp"\n'
    "template double clothctl::twice(double);\n",
    "tests/static/boxed.cpp": '#include "clothctl/clothctl.hpp"\n'
    '#include "static/explicit_scalar.hpp"\n'
    "template clothctl_test::ExplicitDouble clothctl::twice(clothctl_test::ExplicitDouble);\n",
    "tests/static/long_headers.txt": "# none\n",
    "examples/quickstart.cpp": "int main() { return 0; }\n",
    "README.md": "# x\n\n```cpp\nint main() { return 0; }\n```\n\n"
    "See [numbers](docs/numbers.md#colours).\n",
    "docs/numbers.md": "# Numbers\n\n## Colours\n\n"
    "`core/number.hpp` holds `Numbers`; `draw_lines` draws.\n",
    "CMakeLists.txt": "# none\n",
    "CMakePresets.json": "{}\n",
}

NUMBER = "include/clothctl/core/number.hpp"
TWICE = "include/clothctl/math/twice.hpp"
PAINT = "include/clothctl/concepts/paint.hpp"
TWICE_UNIT = ["--unit", "unit.cpp"]

# (what is broken, check, arguments, file, text to replace, replacement or None to remove the file,
# words of the report). A dict instead of a file adds files.
CASES = [
    ("a folder includes one to its right", "check_layers.py", [], NUMBER, "#include <vector>",
     '#include <vector>\n#include "clothctl/mesh/grid.hpp"', "mesh is right of core"),
    ("folders of one brace include each other", "check_layers.py", [],
     "include/clothctl/qp/solver.hpp", "math/twice", "mesh/grid", "stand in one brace"),
    ("two headers include each other", "check_layers.py", [], NUMBER, "#include <vector>",
     '#include <vector>\n#include "clothctl/core/number.hpp"', "include cycle"),
    ("a core header includes a third party", "check_layers.py", [], TWICE, "#pragma once",
     "#pragma once\n#include <nlohmann/json.hpp>", "only the standard library and Eigen"),
    ("a header names an entry header", "check_layers.py", [], TWICE, "clothctl/core/number.hpp",
     "clothctl/core.hpp", "not an entry header"),
    ("an entry header forgets a header", "check_layers.py", [], "include/clothctl/math.hpp",
     '#include "clothctl/math/twice.hpp"', "", "does not include clothctl/math/twice.hpp"),
    ("a header has no guard", "check_layers.py", [], TWICE, "#pragma once", "", "no #pragma once"),
    ("a header needs what it does not include", "check_headers_alone.py", "compiler", NUMBER,
     "#include <vector>", "", "does not compile alone"),
    ("a header does not include the configuration", "check_headers_alone.py", "compiler", NUMBER,
     '#include "clothctl/config.hpp"\n', "", "does not include config.hpp"),
    ("a header shadows a name", "check_headers_alone.py", "compiler", TWICE,
     "  return Scalar(2) * x;",
     "  {\n    Scalar x = Scalar(1);\n    if (x > Scalar(2)) return x;\n  }\n  return x;",
     "does not compile alone"),
    ("a function has no comment", "check_docs.py", [], TWICE, "/// Twice the value.\n", "",
     "'twice' has no doc comment"),
    ("a member has no comment", "check_docs.py", [], NUMBER, "  /// The numbers.\n", "",
     "'Numbers::values' has no doc comment"),
    ("an enumerator has no comment", "check_docs.py", [], NUMBER, "  /// Blue.\n", "",
     "enumerator 'Blue' has no doc comment"),
    ("a struct has only a plain comment", "check_docs.py", [], NUMBER, "/// A list", "// A list",
     "'Numbers' has no doc comment"),
    ("a header has no test", "check_mirror.py", [], "tests/math/twice.cpp", "", None,
     "has no tests/math/twice.cpp"),
    ("a test does not include its header", "check_mirror.py", [], "tests/math/twice.cpp",
     "clothctl/math/twice.hpp", "clothctl/core/number.hpp",
     "does not include clothctl/math/twice.hpp"),
    ("a header grows over 500 lines", "check_length.py", [], TWICE, "namespace clothctl {",
     "namespace clothctl {\n" + "constexpr int k = 0;\n" * 520, "over 500"),
    ("a function grows over 60 lines", "check_length.py", [], TWICE, "  return Scalar(2)",
     "  x = x;\n" * 60 + "  return Scalar(2)", "function of 6"),
    ("a private function does, in detail", "check_length.py", [], TWICE, "/// Twice",
     "namespace detail {\nclass Hidden {\n  void run() const {\n" + "    ;\n" * 60
     + "  }\n};\n}\n\n/// Twice", "void run() const"),
    ("a constructor does, after its initialisers", "check_length.py", [], NUMBER, "  /// How many",
     "  /// Makes them.\n  Numbers() : values{1, 2} {\n" + "    ;\n" * 60 + "  }\n  /// How many",
     "function of 62"),
    ("a folder has over 12 doors", "check_length.py", [],
     {f"include/clothctl/core/extra{i}.hpp": "#pragma once\n" for i in range(12)}, "", "",
     "14 doors, over 12"),
    ("qp has over 6 doors", "check_length.py", [],
     {f"include/clothctl/qp/extra{i}.hpp": "#pragma once\n" for i in range(6)}, "", "",
     "7 doors, over 6"),
    ("a program grows over 150 lines", "check_length.py", [], "examples/quickstart.cpp", "int main",
     "\n" * 150 + "int main", "program of 151 lines"),
    ("a line has 101 columns", "check_columns.py", [], TWICE, "/// Twice the value.",
     "/// " + "é" * 97, "101 columns"),
    ("a page's line has 101 columns", "check_columns.py", [], "docs/numbers.md", "draws.",
     "draws. " + "x " * 40, "columns, over 100"),
    ("a concept constrains nothing", "check_concepts.py", [], "include/clothctl/mesh/grid.hpp",
     "template <AnyPaint Paint>", "template <class Paint>",
     "AnyPaint constrains no public template"),
    ("a concept constrains only what is in detail", "check_concepts.py", [],
     "include/clothctl/mesh/grid.hpp", "namespace clothctl {", "namespace clothctl::detail {",
     "AnyPaint constrains no public template"),
    ("a concept goes through no trait", "check_concepts.py", [], PAINT,
     "paint_traits<Paint>::amount(paint) }", "Paint::total(paint) }",
     "AnyPaint goes through no trait"),
    ("a concept asks the type past its trait", "check_concepts.py", [], PAINT,
     "  { paint_traits<Paint>::amount", "  paint.colour();\n  { paint_traits<Paint>::amount",
     "past its trait, for paint.colour"),
    ("a concept does not speak of hooks", "check_concepts.py", [], PAINT,
     "/// Optional hooks: `glossy` (taken for false where it is missing).", "///",
     "no line `Optional hooks: ...`"),
    ("a hook that nothing knows is named", "check_concepts.py", [], PAINT, "hooks: `glossy`",
     "hooks: `glossy`, `shiny`", "the optional hook `shiny` occurs nowhere"),
    ("a hook hides in the trait", "check_concepts.py", [], PAINT,
     "hooks: `glossy` (taken for false where it is missing).", "hooks: none.",
     "paint_traits::glossy is asked for by no concept"),
    ("a concept has no archetype", "check_concepts.py", [], "tests/archetypes/paint.cpp",
     "static_assert(clothctl::AnyPaint<", "static_assert(!clothctl::AnyPaint<",
     "AnyPaint has no archetype"),
    ("a concept has no law suite", "check_concepts.py", [], "tests/laws/paint_laws.hpp",
     "  static_assert(clothctl::AnyPaint<Paint>);\n", "", "AnyPaint has no law suite"),
    ("a law suite is run by nothing", "check_concepts.py", [], "tests/concepts/paint.cpp",
     '#include "laws/paint_laws.hpp"\n', "", "no test includes its law suite"),
    ("a concept has no foreign type", "check_concepts.py", [], "tests/concepts/paint.cpp",
     "static_assert(clothctl::AnyPaint<other_engine::Ink> && ", "static_assert(",
     "states AnyPaint of no foreign type (Ink)"),
    ("a concept's foreign type has no trait", "check_concepts.py", [], "tests/concepts/paint.cpp",
     "paint_traits<other_engine::Ink>", "paint_traits<Ink>",
     "specialises paint_traits for no foreign type"),
    ("a page links to nothing", "check_pages.py", [], "README.md", "docs/numbers.md#colours",
     "docs/letters.md", "links to docs/letters.md, which does not exist"),
    ("a page links to no heading", "check_pages.py", [], "README.md", "#colours", "#shapes",
     "no such heading"),
    ("a page names a header that is gone", "check_pages.py", [], "docs/numbers.md",
     "core/number.hpp", "core/digit.hpp", "`core/digit.hpp`, which is no file"),
    ("a page names a type that is gone", "check_pages.py", [], "docs/numbers.md", "`Numbers`",
     "`NumberList`", "`NumberList`, which occurs nowhere"),
    ("a page names a function that is gone", "check_pages.py", [], "docs/numbers.md", "draw_lines",
     "draw_circles", "`draw_circles`, which occurs nowhere"),
    ("a page's program uses a type that is gone", "check_pages.py", [], "README.md",
     "int main() { return 0; }", "NumberList all; int main() { return 0; }",
     "`NumberList`, which occurs nowhere"),
    ("a header throws", "check_purity.py", [], TWICE, "return", "if (x < x) throw 1;\n  return",
     "throws"),
    ("a header prints", "check_purity.py", [], TWICE, "return", 'std::printf("x");\n  return',
     "prints"),
    ("a header holds a mutable global", "check_purity.py", [], TWICE, "/// Twice",
     "inline int counter = 0;\n\n/// Twice", "mutable global"),
    ("a file is not formatted", "check_format.py", [], TWICE, "Scalar(2) * x", "Scalar(2)*x",
     "is not formatted"),
    ("a conversion warns", "check_compile.py", ["compiler", *TWICE_UNIT], TWICE,
     "return Scalar(2) * x;", "int i = x;\n  return Scalar(i);", "conversion"),
    ("a header throws without exceptions", "check_compile.py",
     ["compiler", *TWICE_UNIT, "--flags=-fno-exceptions"], TWICE, "return", "throw 1;\n  return",
     "exception"),
    ("a literal is mixed with the scalar", "check_compile.py",
     ["compiler", "--unit", "boxed.cpp", "--flags=-fsyntax-only"], TWICE, "Scalar(2) * x",
     "2.0 * x", "2.0 * x"),
    ("the README shows another program", "check_quickstart.py", [], "README.md", "return 0",
     "return 1 - 1", "differs from examples/quickstart.cpp"),
]


# The functions that the allocation counter counts. If any one is not counted, its self-check must
# fail.
COUNTED = ["malloc", "calloc", "realloc", "aligned_alloc", "posix_memalign"]
CANARY_MAIN = """#include <cstdio>
#include "support/allocations.hpp"
int main() { std::puts(clothctl_test::allocation_counting_works() ? "sings" : "silent"); }
"""


def canary(options, failures):
    """Builds the allocation counter, complete and with one count removed at a time.

    Returns how many removed counts its self-check noticed."""
    text = (options.root / "tests" / "support" / "allocations.cpp").read_text(encoding="utf-8")
    noticed = 0
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)

        def verdict(source):
            (folder / "allocations.cpp").write_text(source, encoding="utf-8")
            (folder / "main.cpp").write_text(CANARY_MAIN, encoding="utf-8")
            command = [options.compiler, "-std=c++20", "-O2", "-I", str(options.root / "tests"),
                       "allocations.cpp", "main.cpp", "-o", "canary"]
            built = subprocess.run(command, cwd=folder, capture_output=True, text=True)
            if built.returncode != 0:
                return built.stderr
            return subprocess.run([str(folder / "canary")], capture_output=True,
                                  text=True).stdout.strip()

        whole = verdict(text)
        if whole != "sings":
            failures.append(f"the allocation canary does not sing with the whole counter: {whole}")
            return 0
        for name in COUNTED:
            head, tail = re.split(rf"(?=\b{name}\((?:std::size_t|void\*)[^;]*\) noexcept \{{)",
                                  text, maxsplit=1)
            broken = head + tail.replace("  count.fetch_add(1, std::memory_order_relaxed);\n", "",
                                         1)
            said = verdict(broken)
            if said != "silent":
                message = f"did not notice that {name} is not counted: {said}"
                failures.append("the allocation canary " + message)
                continue
            noticed += 1
            print(f"noticed: {name} is not counted (allocation canary)")
    return noticed


def main():
    options = arguments(__doc__, compiler={"default": "c++"},
                        system={"default": "/usr/include/eigen3"})
    compiler = ["--compiler", options.compiler, "--system", options.system]
    failures, shown, skipped = [], 0, 0
    healthy = {}

    def run(script, arguments_, root):
        extra = [arguments_] if isinstance(arguments_, str) else arguments_
        flat = [word for item in extra for word in (compiler if item == "compiler" else [item])]
        if script == "check_headers_alone.py":
            flat += ["--jobs", "1"]
        command = [sys.executable, "-B", str(HERE / script), "--root", str(root), *flat]
        result = subprocess.run(command, capture_output=True, text=True)
        return result.returncode, result.stdout + result.stderr

    with tempfile.TemporaryDirectory() as scratch:
        root = Path(scratch)

        def restore():
            for name, text in TREE.items():
                path = root / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(text, encoding="utf-8")

        restore()
        for name in ("layers.txt", "explicit_scalar.hpp"):
            shutil.copy(HERE / name, root / "tests" / "static" / name)
        # The explicit scalar needs the real scalar header.
        for name in ("scalar.hpp",):
            real = options.root / "include" / "clothctl" / "core" / name
            TREE["include/clothctl/core/" + name] = real.read_text(encoding="utf-8")
            TREE["include/clothctl/core.hpp"] += f'#include "clothctl/core/{name}"\n'
            TREE["tests/core/"
                 + name.replace(".hpp", ".cpp")] = f'#include "clothctl/core/{name}"\n'
        for name in (".clang-format",):
            shutil.copy(options.root / name, root / name)
        restore()
        for what, script, arguments_, file, old, new, words in CASES:
            restore()
            key = (script, str(arguments_))
            if key not in healthy:
                healthy[key] = run(script, arguments_, root)
                if healthy[key][0] not in (0, 77):
                    failures.append(f"{script} fails on the healthy tree:\n{healthy[key][1]}")
            if healthy[key][0] == 77:
                skipped += 1
                continue
            added = file if isinstance(file, dict) else {}
            for name, text in added.items():
                (root / name).write_text(text, encoding="utf-8")
            if not added:
                text = TREE[file]
                if old not in text:
                    failures.append(f"{what}: nothing to break in {file}")
                    continue
                if new is None:
                    (root / file).unlink()
                else:
                    (root / file).write_text(text.replace(old, new, 1), encoding="utf-8")
            code, output = run(script, arguments_, root)
            for name in added:
                (root / name).unlink()
            if code != 1 or (words and words not in output):
                failures.append(f"{what}: {script} did not notice (exit code {code}):\n{output}")
                continue
            shown += 1
            print(f"noticed: {what} ({script})")

    shown += canary(options, failures)

    for failure in failures:
        print(failure)
    print(f"selftest: {shown} of {len(CASES) + len(COUNTED)} breaks noticed"
          + (f", {skipped} skipped" if skipped else ""))
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
