#!/usr/bin/env python3
"""Runs the programs on the recorded curves, the built-in tasks and the robot models, and compares
their errors with fixed limits.

    check_figures.py --programs FOLDER_WITH_THE_BINARIES --shared FOLDER [--full]

The quick tier runs one curve of each kind. The full tier (--full or CLOTHCTL_FULL=1) runs every
curve on every plant and grip that has a limit, and takes about a quarter of an hour. The curves are
in data/trajectories under --shared; without them the test is skipped. Limits of the mean error, mm:

    splines/known_*      10 on the one-solve plant, 15 on the Newton plant ([Bai 2016], section 6)
    splines/random_*     16
    splines/fast_*       40
    splines/known_*      500 (the side of the sheet) on XPBD, which the predictor does not model
    iri/ref_*            1.7, with commanded poses and a sheet of 0.3 m
    tasks at 33 x 33     20
    rope_ball            10

Limits for hands, with the models in data/models under --shared: differences from reference results
1e-9 (1e-4 in single precision) for every model; share of targets reached to 1 mm 100 % from near
starts and 99 % from random ones; lag of the hand behind its path 1 mm at 0.3 m/s, for every step.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys


def jobs(shared, full):
    """Yields (name, bar in mm, program, arguments)."""
    curves = shared / "data" / "trajectories"
    sheet = ["--cloth", 17, "--size", 0.5, "--horizon", 20, "--material", "handkerchief"]
    numbers = range(1, 6) if full else [1]
    for plant in ("one-solve", "newton"):
        for grip in ("force", "position"):
            for kind, bar in (("known", 4), ("random", 7)):
                for i in numbers:
                    if full or (plant, grip, kind) in (("newton", "force", "known"),
                                                       ("one-solve", "position", "random")):
                        yield (f"{kind}_{i} {plant} {grip}", bar, "handkerchief",
                               [*sheet, "--targets", curves / "splines" / f"{kind}_{i}.csv",
                                "--plant", plant, "--grip", grip])
    for i in range(1, 9) if full else [1]:
        pair = f"{curves / 'iri' / f'ref_{i}L.csv'},{curves / 'iri' / f'ref_{i}R.csv'}"
        yield (f"iri ref_{i} newton position", 1, "handkerchief",
               ["--targets", pair, "--dt", 0.02, "--size", 0.3, "--plant", "newton", "--grip",
                "position"])
    if not full:
        return
    for i in numbers:
        for grip in ("force", "position"):
            for kind, plant, bar in (("fast", "newton", 7), ("known", "xpbd", 30)):
                yield (f"{kind}_{i} {plant} {grip}", bar, "handkerchief",
                       [*sheet, "--targets", curves / "splines" / f"{kind}_{i}.csv", "--plant",
                        plant, "--grip", grip])
    for plant in ("one-solve", "newton"):
        for task in ("async", "circle", "wind"):
            yield (f"{task} 33x33 {plant}", 20, "handkerchief",
                   ["--task", task, "--cloth", 33, "--horizon", 20, "--plant", plant])
        for grip in ("force", "position"):
            yield f"rope_ball {plant} {grip}", 10, "rope_ball", ["--plant", plant, "--grip", grip]


HANDS = ("hand34", "sia10d_shadow", "shadow_hand_right", "allegro_hand_right", "leap_hand_right",
         "motoman_sia10d")


def hand_jobs(models, full):
    """Yields (name, program, arguments, {key: (least, most)}) for each run with a hand."""
    differences = ("fk_error", "jacobian_error", "mass_error", "bias_error", "gravity_error",
                   "rnea_error", "spd_qdd_error",
                   "spd_tau_error")
    for name in HANDS:
        model = ["--model", models / f"{name}.urdf"]
        for flags, most in (([], 1e-9), (["--float"], 1e-4)):
            bars = {**{key: (0, most) for key in differences}, "fd_error": (0, max(most, 1e-6))}
            oracle = models / "oracle" / f"{name}.json"
            yield f"{name} {' '.join(flags)}", "hand_reach", [*model, "--oracle", oracle,
                                                              *flags], bars
        count = (10000 if name in HANDS[:2] else 1000) if full else 100
        yield (f"{name} reach {count}", "hand_reach", [*model, "--targets", count, "--seed", 2],
               {"reached_share": (0.99, 1), "reached_share_near": (1, 1), "error_m": (0, 1e-3),
                "unreachable_local_minima": (1, 1)})
    for step in (0.02, 0.01, 0.005, 0.002, 0.001) if full else (0.02, 0.002):
        yield (f"hand34 track {step}", "hand_track", ["--step", step],
               {"lag_at_speed_m": (0, 1e-3), "saturated_steps": (0, 0)})
        yield (f"hand34 hold {step}", "hand_track",
               ["--hold", "--no-gravity", "--step", step, "--seconds", 2],
               {"energy_rise_j": (0, 1e-12)})


def check_hands(programs, models, full):
    """Runs the programs for hands; returns how many runs missed a limit."""
    for needed in (models / "oracle", programs / "hand_reach", programs / "hand_track"):
        if not needed.exists():
            print("hands left out: there is no", needed)
            return 0
    failures = 0
    for name, program, arguments, bars in hand_jobs(models, full):
        done = subprocess.run([str(programs / program), *map(str, arguments), "--json"],
                              capture_output=True, text=True, timeout=1200)
        s = json.loads(done.stdout) if done.stdout.startswith("{") else {}
        missed = [key for key, (least, most) in bars.items()
                  if s.get(key) is None or not least <= s[key] <= most]
        missed += [f"exit {done.returncode}"] if done.returncode else []
        failures += bool(missed)
        if "fd_error" in bars:
            worst = max(bars, key=lambda key: s.get(key) or 0)
            shown = f"largest difference {s.get(worst)} ({worst})"
        else:
            shown = ", ".join(f"{key} {s.get(key)}" for key in bars)
        print(f"{name:32} {shown}{'   MISSED ' + ', '.join(missed) if missed else ''}",
              done.stderr.strip(), flush=True)
    return failures


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--programs", type=pathlib.Path, required=True)
    parser.add_argument("--shared", type=pathlib.Path, required=True)
    parser.add_argument("--full", action="store_true",
                        default=os.environ.get("CLOTHCTL_FULL", "") not in ("", "0"))
    options = parser.parse_args()
    shared = pathlib.Path(os.environ.get("CLOTHCTL_SHARED") or options.shared)
    for needed in (shared / "data" / "trajectories" / "splines", options.programs / "handkerchief",
                   options.programs / "rope_ball"):
        if not needed.exists():
            print("skipped: there is no", needed)
            return 77
    failures = check_hands(options.programs, shared / "data" / "models", options.full)
    print(f"{'run':32} {'bar':>5} {'mean':>6} {'95 %':>6} {'max':>6}   mm   "
          f"{'plan':>6} {'plant':>6}   ms a frame, median")
    for name, bar, program, arguments in jobs(shared, options.full):
        done = subprocess.run([str(options.programs / program), *map(str, arguments), "--json"],
                              capture_output=True, text=True,
                              timeout=1200)
        if done.returncode != 0:
            failures += 1
            said = done.stderr.strip() or done.stdout.strip()
            print(f"{name:32} FAILED: exit {done.returncode}: {said}")
            continue
        s = json.loads(done.stdout.strip().split("\n")[-1])
        missed = not 1000 * s["mean_error_m"] <= bar or s["cone_violation_max"] > 1e-9
        failures += missed
        mean, p95, largest = (1000 * s[f"{key}_error_m"] for key in ("mean", "p95", "max"))
        print(f"{name:32} {bar:5} {mean:6.2f} {p95:6.2f} {largest:6.1f}        "
              f"{s['frame_ms_median']:6.2f} {s['plant_ms_median']:6.2f}"
              f"{'   MISSED' if missed else ''}", flush=True)
    print(f"{failures} missed")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
