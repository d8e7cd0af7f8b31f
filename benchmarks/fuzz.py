"""Damaged and odd inputs: `python -m benchmarks.fuzz --cases 5000 --seed 1`.

Each case is read in a process that may die. Other outcomes than `read` and `refused` are printed
with the command that repeats them; the exit status is then 1. `lost` is an input that was read
wrongly without a warning, such as a video with missing frames.
"""

import argparse
import logging
import resource
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.fuzz_cases import KINDS
from shaftpose.core.errors import InputError

LONGEST_S, MOST_MIB = 20, 2048  # of processor time and memory
GOOD = "read", "refused"


def main() -> None:
    """Run the cases, and print how many ended how."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--cases", type=int, default=5000, help="number of cases (5000)")
    parser.add_argument("--seed", type=int, default=0, help="of the cases (0)")
    parser.add_argument("--first", type=int, default=0, help="number of the first case (0)")
    parser.add_argument("--here", action="store_true", help="in this process")
    options = parser.parse_args()
    if options.here:
        work(options.seed, options.first, options.first + options.cases)
        return
    found = run(options.seed, options.first, options.first + options.cases)
    for (kind, outcome), count in sorted(found.items()):
        print(f"{kind:12}{outcome:12}{count}")
    sys.exit(any(outcome not in GOOD for _, outcome in found))


def run(seed: int, first: int, end: int) -> Counter[tuple[str, str]]:
    """How many cases of each kind ended how, from processes that are replaced when they die."""
    found: Counter[tuple[str, str]] = Counter()
    while first < end:
        command = [sys.executable, "-m", "benchmarks.fuzz", "--here", f"--seed={seed}"]
        numbers = [f"--first={first}", f"--cases={end - first}"]
        with subprocess.Popen([*command, *numbers], stdout=subprocess.PIPE, text=True) as process:
            for line in process.stdout or ():
                outcome, _, reason = line.removeprefix("case ").strip().partition(" ")
                first = (
                    note(found, seed, first, outcome, reason) if line.startswith("case ") else first
                )
        if process.returncode and first < end:
            hung = process.returncode == -signal.SIGPROF
            first = note(found, seed, first, "hang" if hung else "crash", str(process.returncode))
    return found


def note(found: Counter[tuple[str, str]], seed: int, number: int, outcome: str, reason: str) -> int:
    """Count an outcome; returns the number of the next case."""
    kind = KINDS[number % len(KINDS)].__name__
    found[kind, outcome] += 1
    if outcome not in GOOD:
        again = f"python -m benchmarks.fuzz --here --seed {seed} --first {number} --cases 1"
        print(f"{kind}: {outcome}: {reason}\n    {again}", flush=True)
    return number + 1


def work(seed: int, first: int, end: int) -> None:
    """Read cases in this process, and print a line for each. A hang ends it by SIGPROF; it ends
    itself after a case that takes too much memory."""
    logging.disable(logging.CRITICAL)
    for number in range(first, end):
        signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
        outcome = outcome_of(seed, number)
        signal.setitimer(signal.ITIMER_PROF, 0)
        mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
        print(f"case {f'memory {mib} MiB' if mib > MOST_MIB else outcome}", flush=True)
        if mib > MOST_MIB:
            return


def outcome_of(seed: int, number: int) -> str:
    """How a case ended, in a word, and perhaps why."""
    with TemporaryDirectory() as folder:
        try:
            KINDS[number % len(KINDS)](Path(folder), np.random.default_rng([seed, number]))
        except InputError as error:
            return "refused" if str(error) and "\n" not in str(error) else f"mute {error!r}"
        except AssertionError as error:
            return f"lost {error!r}"
        except Exception as error:
            return f"traceback {error!r}".replace("\n", " ")
    return "read"


if __name__ == "__main__":
    main()
