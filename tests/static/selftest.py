#!/usr/bin/env python3
"""Shows that every check fails when the rule that it guards is broken: copies the tree, breaks one thing, runs the check, and
expects exit code 1 and a line that names the broken place. A check must also pass on the small healthy tree it starts from."""

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from house import arguments

HERE = Path(__file__).resolve().parent

# A healthy little library in the shape of the real one.
TREE = {
    "include/clothctl/config.hpp": "#pragma once\n\n#define CLOTHCTL_VERSION_STRING \"0\"\n",
    "include/clothctl/clothctl.hpp": '#pragma once\n\n#include "clothctl/core.hpp"\n#include "clothctl/math.hpp"\n#include "clothctl/mesh.hpp"\n#include "clothctl/qp.hpp"\n',
    "include/clothctl/core.hpp": '#pragma once\n\n#include "clothctl/core/number.hpp"\n',
    "include/clothctl/math.hpp": '#pragma once\n\n#include "clothctl/math/twice.hpp"\n',
    "include/clothctl/mesh.hpp": '#pragma once\n\n#include "clothctl/mesh/grid.hpp"\n',
    "include/clothctl/qp.hpp": '#pragma once\n\n#include "clothctl/qp/solver.hpp"\n',
    "include/clothctl/core/number.hpp": """#pragma once

#include <vector>

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
    "include/clothctl/mesh/grid.hpp": '#pragma once\n\n#include "clothctl/math/twice.hpp"\n',
    "include/clothctl/qp/solver.hpp": '#pragma once\n\n#include "clothctl/math/twice.hpp"\n',
    "tests/core/number.cpp": '#include "clothctl/core/number.hpp"\n',
    "tests/math/twice.cpp": '#include "clothctl/math/twice.hpp"\n',
    "tests/mesh/grid.cpp": '#include "clothctl/mesh/grid.hpp"\n',
    "tests/qp/solver.cpp": '#include "clothctl/qp/solver.hpp"\n',
    "tests/static/unit.cpp": '#include "clothctl/clothctl.hpp"\ntemplate double clothctl::twice(double);\n',
    "tests/static/boxed.cpp": '#include "clothctl/clothctl.hpp"\n#include "static/explicit_scalar.hpp"\n'
    "template clothctl_test::ExplicitDouble clothctl::twice(clothctl_test::ExplicitDouble);\n",
    "tests/static/long_headers.txt": "# none\n",
    "examples/quickstart.cpp": "int main() { return 0; }\n",
    "README.md": "# x\n\n```cpp\nint main() { return 0; }\n```\n",
}

NUMBER = "include/clothctl/core/number.hpp"
TWICE = "include/clothctl/math/twice.hpp"
TWICE_UNIT = ["--unit", "unit.cpp"]

# (what is broken, check, arguments, file, text to replace, replacement or None for no file at all, words of the report)
CASES = [
    ("a folder includes one to its right", "check_layers.py", [], NUMBER, "#include <vector>", '#include <vector>\n#include "clothctl/mesh/grid.hpp"', "mesh is right of core"),
    ("folders of one brace include each other", "check_layers.py", [], "include/clothctl/qp/solver.hpp", "math/twice", "mesh/grid", "stand in one brace"),
    ("two headers include each other", "check_layers.py", [], NUMBER, "#include <vector>", '#include <vector>\n#include "clothctl/core/number.hpp"', "include cycle"),
    ("a core header includes a third party", "check_layers.py", [], TWICE, "#pragma once", "#pragma once\n#include <nlohmann/json.hpp>", "only the standard library and Eigen"),
    ("a header names an entry header", "check_layers.py", [], TWICE, "clothctl/core/number.hpp", "clothctl/core.hpp", "not an entry header"),
    ("an entry header forgets a header", "check_layers.py", [], "include/clothctl/math.hpp", '#include "clothctl/math/twice.hpp"', "", "does not include clothctl/math/twice.hpp"),
    ("a header has no guard", "check_layers.py", [], TWICE, "#pragma once", "", "no #pragma once"),
    ("a header needs what it does not include", "check_headers_alone.py", "compiler", NUMBER, "#include <vector>", "", "does not compile alone"),
    ("a header shadows a name", "check_headers_alone.py", "compiler", TWICE, "  return Scalar(2) * x;", "  {\n    Scalar x = Scalar(1);\n    if (x > Scalar(2)) return x;\n  }\n  return x;", "does not compile alone"),
    ("a function has no comment", "check_docs.py", [], TWICE, "/// Twice the value.\n", "", "'twice' has no doc comment"),
    ("a member has no comment", "check_docs.py", [], NUMBER, "  /// The numbers.\n", "", "'Numbers::values' has no doc comment"),
    ("an enumerator has no comment", "check_docs.py", [], NUMBER, "  /// Blue.\n", "", "enumerator 'Blue' has no doc comment"),
    ("a struct has only a plain comment", "check_docs.py", [], NUMBER, "/// A list", "// A list", "'Numbers' has no doc comment"),
    ("a header has no test", "check_mirror.py", [], "tests/math/twice.cpp", "", None, "has no tests/math/twice.cpp"),
    ("a test does not include its header", "check_mirror.py", [], "tests/math/twice.cpp", "clothctl/math/twice.hpp", "clothctl/core/number.hpp", "does not include clothctl/math/twice.hpp"),
    ("a header grows over 500 lines", "check_length.py", [], TWICE, "namespace clothctl {", "namespace clothctl {\n" + "constexpr int k = 0;\n" * 520, "over 500"),
    ("a header throws", "check_purity.py", [], TWICE, "return", "if (x < x) throw 1;\n  return", "throws"),
    ("a header prints", "check_purity.py", [], TWICE, "return", 'std::printf("x");\n  return', "prints"),
    ("a header holds a mutable global", "check_purity.py", [], TWICE, "/// Twice", "inline int counter = 0;\n\n/// Twice", "mutable global"),
    ("a file is not formatted", "check_format.py", [], TWICE, "Scalar(2) * x", "Scalar(2)*x", "is not formatted"),
    ("a conversion warns", "check_compile.py", ["compiler", *TWICE_UNIT], TWICE, "return Scalar(2) * x;", "int i = x;\n  return Scalar(i);", "conversion"),
    ("a header throws without exceptions", "check_compile.py", ["compiler", *TWICE_UNIT, "--flags=-fno-exceptions"], TWICE, "return", "throw 1;\n  return", "exception"),
    ("a literal is mixed with the scalar", "check_compile.py", ["compiler", "--unit", "boxed.cpp", "--flags=-fsyntax-only"], TWICE, "Scalar(2) * x", "2.0 * x", "2.0 * x"),
    ("the README shows another program", "check_quickstart.py", "compiler", "README.md", "return 0", "return 1 - 1", "differs from examples/quickstart.cpp"),
    ("the README's program does not compile", "check_quickstart.py", "compiler", "README.md", "return 0", "return zero", "does not compile"),
]


# The counted entry points of the allocation counter; without any one of them the canary must say no.
COUNTED = ["malloc", "calloc", "realloc", "aligned_alloc", "posix_memalign"]
CANARY_MAIN = """#include <cstdio>
#include "support/allocations.hpp"
int main() { std::puts(clothctl_test::allocation_counting_works() ? "sings" : "silent"); }
"""


def canary(options, failures):
    """Builds the allocation counter whole and with one count removed at a time; returns how many breaks were noticed."""
    text = (options.root / "tests" / "support" / "allocations.cpp").read_text(encoding="utf-8")
    noticed = 0
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)

        def verdict(source):
            (folder / "allocations.cpp").write_text(source, encoding="utf-8")
            (folder / "main.cpp").write_text(CANARY_MAIN, encoding="utf-8")
            command = [options.compiler, "-std=c++20", "-O2", "-I", str(options.root / "tests"), "allocations.cpp", "main.cpp", "-o", "canary"]
            built = subprocess.run(command, cwd=folder, capture_output=True, text=True)
            if built.returncode != 0:
                return built.stderr
            return subprocess.run([str(folder / "canary")], capture_output=True, text=True).stdout.strip()

        whole = verdict(text)
        if whole != "sings":
            failures.append(f"the allocation canary does not sing with the whole counter: {whole}")
            return 0
        for name in COUNTED:
            head, tail = re.split(rf"(?=\b{name}\((?:std::size_t|void\*)[^;]*\) noexcept \{{)", text, maxsplit=1)
            broken = head + tail.replace("  count.fetch_add(1, std::memory_order_relaxed);\n", "", 1)
            said = verdict(broken)
            if said != "silent":
                failures.append(f"the allocation canary did not notice that {name} is not counted: {said}")
                continue
            noticed += 1
            print(f"noticed: {name} is not counted (allocation canary)")
    return noticed


def main():
    options = arguments(__doc__, compiler={"default": "c++"}, system={"default": "/usr/include/eigen3"})
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
        # The explicit scalar leans on the real scalar header.
        for name in ("scalar.hpp",):
            real = options.root / "include" / "clothctl" / "core" / name
            TREE["include/clothctl/core/" + name] = real.read_text(encoding="utf-8")
            TREE["include/clothctl/core.hpp"] += f'#include "clothctl/core/{name}"\n'
            TREE["tests/core/" + name.replace(".hpp", ".cpp")] = f'#include "clothctl/core/{name}"\n'
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
            text = TREE[file]
            if old not in text:
                failures.append(f"{what}: nothing to break in {file}")
                continue
            if new is None:
                (root / file).unlink()
            else:
                (root / file).write_text(text.replace(old, new, 1), encoding="utf-8")
            code, output = run(script, arguments_, root)
            if code != 1 or (words and words not in output):
                failures.append(f"{what}: {script} did not notice (exit code {code}):\n{output}")
                continue
            shown += 1
            print(f"noticed: {what} ({script})")

    shown += canary(options, failures)

    for failure in failures:
        print(failure)
    print(f"selftest: {shown} of {len(CASES) + len(COUNTED)} breaks noticed" + (f", {skipped} skipped" if skipped else ""))
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
