#!/usr/bin/env python3
"""Runs the example programs as a user would: short runs of every plant and grip, their files and figures, and bad input,
which must end with exit code 2 and one line that names the item.

    check_programs.py --programs FOLDER_WITH_THE_BINARIES
"""

import argparse
import json
import math
import pathlib
import re
import subprocess
import sys
import tempfile

KEYS = ["status", "frames", "mean_error_m", "p95_error_m", "max_error_m", "frame_ms_median", "frame_ms_p99", "plant_ms_median",
        "agreement", "qp_iterations_median", "cone_violation_max", "hand_speed_max"]
failures = []


def check(condition, what):
    if not condition:
        failures.append(what)
        print("FAILED:", what)


def run(program, *arguments):
    done = subprocess.run([str(program), *map(str, arguments)], capture_output=True, text=True, timeout=600)
    return done.returncode, done.stdout, done.stderr


def targets(seconds, header="t,Lx,Ly,Lz,Rx,Ry,Rz", spoil=None):
    """A gentle motion of two corners, half a metre apart; `spoil(rows)` may change the lines."""
    rows = [header] if header else []
    for i in range(round(seconds / 0.02) + 1):
        t = 0.02 * i
        y = 0.05 * (1 - math.cos(math.pi * t)) / 2
        numbers = [t] if header else []
        numbers += [-0.225, y, -0.5, 0.225, y, -0.5] if header else [0.0, y, -0.5]
        rows.append(",".join(f"{v:.9g}" for v in numbers))
    if spoil:
        spoil(rows)
    return "\n".join(rows) + "\n"


def without_times(summary):
    return {k: v for k, v in summary.items() if "_ms_" not in k}


def check_runs(programs, folder):
    hand = programs / "handkerchief"
    curve = folder / "curve.csv"
    curve.write_text(targets(1.0))
    sheet = ["--cloth", 7, "--size", 0.4, "--json"]
    small = [*sheet, "--horizon", 10]
    for plant, grips, bound in (("one-solve", ("force", "position", "planned-position"), 0.02),
                                ("newton", ("force", "position"), 0.02), ("xpbd", ("position",), 0.1)):
        for grip in grips:
            name = f"handkerchief --plant {plant} --grip {grip}"
            out = folder / f"{plant}_{grip}"
            arguments = [*small, "--targets", curve, "--plant", plant, "--grip", grip]
            code, text, errors = run(hand, *arguments, "--out", out)
            check(code == 0 and not errors, f"{name}: exit {code}, stderr {errors!r}")
            if code != 0:
                continue
            summary = json.loads(text.strip().split("\n")[-1])
            check(list(summary)[:len(KEYS)] == KEYS or all(k in summary for k in KEYS), f"{name}: keys {list(summary)}")
            check(summary["status"] == "finished" and summary["frames"] == 50, f"{name}: {summary['status']}")
            check(0 < summary["mean_error_m"] < bound, f"{name}: mean error {summary['mean_error_m']}")
            check(summary["mean_error_m"] <= summary["max_error_m"], f"{name}: mean over max")
            check(summary["cone_violation_max"] <= 1e-9, f"{name}: cone violation {summary['cone_violation_max']}")
            check(summary["scored_frames"] == 40 and summary["setup"]["targets"] == str(curve), f"{name}: {summary}")
            check(summary["setup"]["predictor"] == ("frozen" if plant == "xpbd" else "rollout"), f"{name}: predictor not told")
            check(json.loads((out / "summary.json").read_text()) == summary, f"{name}: summary.json differs from the printed line")
            table = (out / "trajectory.csv").read_text().strip().split("\n")
            check(len(table) == 52, f"{name}: trajectory.csv has {len(table)} lines")
            check(len({line.count(",") for line in table}) == 1, f"{name}: rows of trajectory.csv differ in length")
            page = (out / "player.html").read_text()
            check(page.lower().startswith("<!doctype html>") and not re.search(r"(src|href|url)\s*[=(]\s*.?https?:", page),
                  f"{name}: player.html is not self-contained")
            again = json.loads(run(hand, *arguments)[1].strip().split("\n")[-1])
            check(without_times(again) == without_times(summary), f"{name}: two runs differ")
    for task in ("async", "circle", "wind"):
        code, text, _ = run(hand, *small, "--task", task, "--plant", "one-solve")
        check(code == 0 and json.loads(text)["mean_error_m"] < 0.03, f"handkerchief --task {task}: exit {code}: {text}")
    left, right = folder / "left.csv", folder / "right.csv"
    left.write_text(targets(1.0, header=""))
    right.write_text(targets(1.0, header=""))
    code, text, _ = run(hand, *small, "--targets", f"{left},{right}", "--dt", 0.02, "--plant", "one-solve", "--grip", "position")
    check(code == 0 and json.loads(text)["frames"] == 50, f"handkerchief --targets LEFT,RIGHT: exit {code}")
    for patch in ("soft", "hard"):
        code, text, _ = run(hand, *sheet, "--horizon", 4, "--targets", curve, "--plant", "one-solve", "--patch", patch, "--patch-size",
                            3)
        check(code == 0 and json.loads(text)["mean_error_m"] < 0.05, f"handkerchief --patch {patch}: exit {code}")
    for plant in ("one-solve", "newton"):
        for grip in ("force", "position"):
            code, text, _ = run(programs / "rope_ball", "--plant", plant, "--grip", grip, "--json")
            check(code == 0 and json.loads(text)["mean_error_m"] < 0.01, f"rope_ball {plant} {grip}: exit {code}: {text}")
    code, text, _ = run(programs / "quickstart")
    check(code == 0 and text.strip(), f"quickstart: exit {code}")
    code, text, _ = run(programs / "foreign_plant")
    error = re.search(r"mean error of ([0-9.]+) mm", text)
    check(code == 0 and error and float(error[1]) < 5, f"foreign_plant: exit {code}: {text}")


def check_bad_input(programs, folder):
    hand = programs / "handkerchief"

    def bad(name, wanted, *arguments, program=hand):
        code, text, errors = run(program, *arguments)
        shown = f"{name}: exit {code}, stdout {text!r}, stderr {errors!r}"
        check(code == 2 and not text and errors.endswith("\n") and errors.count("\n") == 1, shown)
        for word in wanted:
            check(word in errors, f"{name}: no {word!r} in {errors!r}")

    def file(name, text):
        path = folder / name
        path.write_text(text)
        return path

    def spoil(line, replacement):
        def change(rows):
            rows[line] = replacement
        return change

    bad("missing file", ["none.csv"], "--targets", folder / "none.csv")
    bad("empty file", ["empty.csv"], "--targets", file("empty.csv", ""))
    bad("header alone", ["header.csv"], "--targets", file("header.csv", "t,Lx,Ly,Lz,Rx,Ry,Rz\n"))
    bad("short row", ["short.csv", "5"], "--targets", file("short.csv", targets(1, spoil=spoil(4, "0.06,1,2"))))
    bad("NaN", ["nan.csv", "5"], "--targets", file("nan.csv", targets(1, spoil=spoil(4, "0.06,nan,0,-0.5,0.2,0,-0.5"))))
    bad("text", ["text.csv", "5", "up"], "--targets", file("text.csv", targets(1, spoil=spoil(4, "0.06,up,0,-0.5,0.2,0,-0.5"))))
    bad("time stands", ["time.csv", "5"], "--targets", file("time.csv", targets(1, spoil=spoil(4, "0.04,-0.2,0,-0.5,0.2,0,-0.5"))))
    bad("short targets", ["brief.csv", "15", "20"], "--targets", file("brief.csv", targets(0.3)))
    bad("folder for a file", [str(folder)], "--targets", folder)
    bad("pair without a partner", ["none.csv"], "--targets", f"{file('one.csv', targets(1, header=''))},{folder / 'none.csv'}")
    bad("features off the mesh", ["--features", "300"], "--features", "0,300")
    bad("features that are not numbers", ["--features", "x"], "--features", "0,x")
    bad("horizon 0", ["--horizon", "0"], "--horizon", 0)
    bad("horizon too long", ["--horizon", "100000"], "--horizon", 100000)
    bad("negative friction", ["--friction", "-0.5"], "--friction", -0.5)
    bad("friction NaN", ["--friction", "nan"], "--friction", "nan")
    bad("limit 0", ["--limit", "0"], "--limit", 0)
    bad("three generators", ["--generators", "3"], "--generators", 3)
    bad("cloth of one vertex", ["--cloth", "1"], "--cloth", 1)
    bad("negative size", ["--size", "-1"], "--size", -1)
    bad("size NaN", ["--size", "nan"], "--size", "nan")
    bad("unknown material", ["silkworm"], "--material", "silkworm")
    bad("material file that is missing", ["none.json"], "--material", folder / "none.json")
    bad("material file that is no JSON", ["bad.json"], "--material", file("bad.json", "{"))
    bad("material with a negative density", ["heavy.json", "-1"], "--material", file("heavy.json", '{"area_density": -1}'))
    bad("unknown plant", ["--plant", "jelly"], "--plant", "jelly")
    bad("unknown option", ["--colour"], "--colour", "red")
    bad("negative seed", ["--seed", "-1"], "--seed", -1)
    bad("dt with a header", ["--dt"], "--targets", file("dt.csv", targets(1)), "--dt", 0.02)
    bad("dt without targets", ["--dt", "--targets"], "--dt", 0.02)
    bad("task and targets", ["--task", "--targets"], "--targets", folder / "dt.csv", "--task", "circle")
    bad("unknown task", ["--task", "spiral"], "--task", "spiral")
    bad("patches that meet", ["--patch-size", "9"], "--patch-size", 9)
    bad("spread 0", ["--spread", "0"], "--spread", 0)
    bad("out in a file", ["dt.csv"], "--cloth", 5, "--horizon", 5, "--targets", file("dt.csv", targets(0.4)), "--out",
        folder / "dt.csv" / "x")
    bad("rope of one vertex", ["--cloth", "1"], "--cloth", 1, program=programs / "rope_ball")
    bad("rope without a ball", ["--radius", "-1"], "--radius", -1, program=programs / "rope_ball")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--programs", type=pathlib.Path, required=True)
    programs = parser.parse_args().programs
    missing = [name for name in ("handkerchief", "rope_ball", "quickstart", "foreign_plant") if not (programs / name).exists()]
    if missing:
        print("skipped: not built:", ", ".join(missing))
        return 77
    with tempfile.TemporaryDirectory() as folder:
        check_bad_input(programs, pathlib.Path(folder))
        check_runs(programs, pathlib.Path(folder))
    print(f"{len(failures)} failures")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
