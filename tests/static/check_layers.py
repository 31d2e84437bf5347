#!/usr/bin/env python3
"""Checks the include order declared in layers.txt.

1. A header in folder F includes only config.hpp, its own folder, and folders left of F. There is
   no cycle.
2. Core headers (all except the `outside` folders) include only the standard library and Eigen.
3. The entry header F.hpp includes every header of F outside F/detail, and nothing else.
4. Only F includes the headers in F/detail.
5. The umbrella clothctl.hpp includes every entry header except those of the `outside` folders.
6. Every header has #pragma once.
"""

import re

from house import Report, arguments, headers, includes, read

STANDARD = set(
    """algorithm any array atomic barrier bit bitset cassert cctype cerrno cfenv cfloat charconv
    chrono cinttypes climits clocale cmath compare complex concepts condition_variable coroutine
    csetjmp csignal cstdarg cstddef cstdint cstdio cstdlib cstring ctime cuchar cwchar cwctype
    deque exception execution filesystem format forward_list fstream functional future
    initializer_list iomanip ios iosfwd iostream istream iterator latch limits list locale map
    memory memory_resource mutex new numbers numeric optional ostream queue random ranges ratio
    regex scoped_allocator semaphore set shared_mutex source_location span sstream stack
    stdexcept stop_token streambuf string string_view syncstream system_error thread tuple
    type_traits typeindex typeinfo unordered_map unordered_set utility valarray variant vector
    version""".split()
)


def declared_layers(path):
    """Returns ({folder: (rank, brace)}, [outside folders]) from layers.txt."""
    rank, outside = {}, []
    for line in path.read_text(encoding="utf-8").splitlines():
        line = line.split("#")[0].strip()
        if line.startswith("outside:"):
            outside = [name.strip() for name in line.split(":", 1)[1].split(",")]
        elif "->" in line:
            for position, group in enumerate(line.split("->")):
                for name in re.findall(r"\w+", group):
                    rank[name] = position
    return rank, outside


def find_cycle(graph):
    """Returns a list of headers that form a cycle, or None."""
    state, stack = {}, []

    def visit(node):
        state[node] = 1
        stack.append(node)
        for target in sorted(graph.get(node, ())):
            if state.get(target) == 1:
                return stack[stack.index(target) :] + [target]
            if target not in state:
                cycle = visit(target)
                if cycle:
                    return cycle
        stack.pop()
        state[node] = 2
        return None

    for node in sorted(graph):
        if node not in state:
            cycle = visit(node)
            if cycle:
                return cycle
    return None


def main():
    options = arguments(__doc__)
    report = Report("include order")
    rank, outside = declared_layers(options.root / "tests" / "static" / "layers.txt")
    all_headers = headers(options.root)
    known = {h.as_posix() for h in all_headers}
    others = ("config.hpp", "clothctl.hpp")
    entries = {h.as_posix() for h in all_headers if len(h.parts) == 1 and h.name not in others}
    graph = {}
    for header in all_headers:
        name = header.as_posix()
        shown = "include/clothctl/" + name
        text = read(options.root, header)
        if not re.search(r"^#pragma once$", text, re.M):
            report.add(shown, 0, "has no #pragma once")
        folder = header.parts[0] if len(header.parts) > 1 else header.stem
        umbrella, config = name == "clothctl.hpp", name == "config.hpp"
        if not umbrella and not config and folder not in rank:
            report.add(shown, 0, f"folder '{folder}' is not declared in layers.txt")
            continue
        mine = graph.setdefault(name, set())
        for line, _, target in includes(text):
            if not target.startswith("clothctl/"):
                third_party = target not in STANDARD and not target.startswith("Eigen/")
                # config.hpp includes the compiler's intrinsics before Eigen does. It rejects older
                # C++ standards by including a file that does not exist.
                if config and target in ("immintrin.h", "clothctl needs C++20"):
                    continue
                if third_party and folder not in outside:
                    message = "only the standard library and Eigen may be included here"
                    report.add(shown, line, f"includes <{target}>: {message}")
                continue
            inner = target[len("clothctl/") :]
            if inner not in known:
                report.add(shown, line, f"includes {target}, which does not exist")
                continue
            mine.add(inner)
            other = inner.split("/")[0] if "/" in inner else None
            if config:
                report.add(shown, line, "config.hpp includes nothing of clothctl")
            elif inner == "config.hpp":
                pass
            elif umbrella:
                if inner not in entries:
                    report.add(shown, line, f"the umbrella includes entry headers, not {target}")
            elif "/detail/" in inner and (other != folder or name in entries):
                message = f"only headers of {other}/ may include what lies in its detail/"
                report.add(shown, line, f"includes {target}: {message}")
            elif other is None:
                message = "name the header that is needed, not an entry header"
                report.add(shown, line, f"includes {target}: {message}")
            elif name in entries:
                if other != folder:
                    report.add(shown, line, f"the entry header of {folder} includes {target}")
            elif other != folder and other in rank:
                if rank[other] == rank[folder]:
                    report.add(shown, line,
                               f"includes {target}: {folder} and {other} stand in one brace")
                elif rank[other] > rank[folder]:
                    report.add(shown, line, f"includes {target}: {other} is right of {folder}")
    cycle = find_cycle(graph)
    if cycle:
        report.add("include/clothctl/" + cycle[0], 0, "include cycle: " + " -> ".join(cycle))
    # Entry headers are complete.
    folders = sorted({h.parts[0] for h in all_headers if len(h.parts) > 1})
    for folder in folders:
        entry = folder + ".hpp"
        if folder == "bridge":
            continue  # each adapter needs its own library, so there is no header for all of them
        if entry not in known:
            report.add("include/clothctl/" + entry, 0,
                       f"the entry header of {folder}/ does not exist")
            continue
        for header in all_headers:
            inner = header.as_posix()
            listed = inner in graph.get(entry, ())
            if len(header.parts) == 2 and header.parts[0] == folder and not listed:
                report.add("include/clothctl/" + entry, 0,
                           f"does not include clothctl/{inner}; run scripts/update_entry_headers")
        if "clothctl.hpp" in known:
            inside = entry in graph.get("clothctl.hpp", ())
            if inside and folder in outside:
                report.add("include/clothctl/clothctl.hpp", 0,
                           f"includes the outside folder {folder}")
            if not inside and folder not in outside:
                report.add("include/clothctl/clothctl.hpp", 0, f"does not include clothctl/{entry}")
    report.finish(f"{len(all_headers)} headers in {len(folders)} folders, order kept, no cycle")


if __name__ == "__main__":
    main()
