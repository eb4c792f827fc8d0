"""A long hunt: ``python -m tests.fuzz csv --count 2000 --seed 0 --found FOLDER``; ``make fuzz`` runs all.

Each case with something wrong is printed, and its input is kept in FOLDER with the reason beside it.
Exit code 1 where anything was found.
"""

import argparse
import faulthandler
import resource
import signal
import sys
import tempfile
import time
import traceback
from pathlib import Path

from gcs.commands.compiled import prepare
from gcs.outputs.console import screen
from tests.fuzz import feeds, logs

HUNG_S = 120.0  # of processor: a busy machine, or one that was asleep, is no hang


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("what", nargs="*", choices=["logs", *feeds.TARGETS], default=["logs", *feeds.TARGETS])
    parser.add_argument("--count", type=int, default=2_000)
    parser.add_argument("--seed", type=int, default=0, help="of the first case")
    parser.add_argument("--longest", type=int, default=400_000, help="bytes of a damaged log")
    parser.add_argument("--found", type=Path, default=Path("found"), help="folder for what was found")
    args = parser.parse_args()
    faulthandler.register(signal.SIGPROF, chain=True)  # where it hangs, then the end of the process
    prepare()
    screen.quiet = True  # thousands of runs would each print their table
    hunts = {"logs": hunt_logs} | dict.fromkeys(feeds.TARGETS, hunt_feeds)
    return 1 if sum(hunts[what](args, what) for what in args.what) else 0


def hunt_logs(args: argparse.Namespace, _: str) -> int:
    """How many damaged logs had something wrong."""
    names = [*logs.REAL, "sample"]
    opened = {name: logs.opened(name) for name in names}
    beside = {name: logs.SAMPLE / f"{name}.csv" for name in ("theo-north", "theo-east", "radar-1")}
    begun, bad = time.monotonic(), 0
    for number in range(args.count):
        seed = args.seed + number
        of = logs.case(opened[names[number % len(names)]], seed, args.longest)
        signal.setitimer(signal.ITIMER_PROF, HUNG_S)
        with tempfile.TemporaryDirectory() as folder:
            try:
                found = logs.problems(of, Path(folder), beside if of.log.name == "sample" else None)
            except Exception:  # whatever a damaged log raises is a finding
                found = [traceback.format_exc()]
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        if found:
            bad += 1
            keep(args.found, f"{of.log.name}-{seed}.tlog", of.damaged.data.tobytes(), "\n".join(found))
        if number % 50 == 49:
            print(f"{number + 1} logs, {bad} with findings, {time.monotonic() - begun:.0f} s", flush=True)
    print(f"{args.count} damaged logs, {bad} with findings, {time.monotonic() - begun:.0f} s")
    return bad


def hunt_feeds(args: argparse.Namespace, what: str) -> int:
    """How many inputs of one target had something wrong; says the slowest one and the memory too."""
    begun, bad, slowest, before = time.monotonic(), 0, (0.0, 0), _memory_mb()
    for seed in range(args.seed, args.seed + args.count):
        data, started = feeds.made(what, seed), time.monotonic()
        signal.setitimer(signal.ITIMER_PROF, HUNG_S)
        try:
            found = feeds.TARGETS[what].wrong(data)
        except Exception:  # whatever a damaged input raises is a finding
            found = traceback.format_exc()
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        slowest = max(slowest, (time.monotonic() - started, seed))
        if found:
            bad += 1
            keep(args.found, f"{what}-{seed}", data, found)
    print(
        f"{args.count} inputs for {what}, {bad} with findings, {time.monotonic() - begun:.0f} s, the slowest "
        f"{slowest[0]:.2f} s (seed {slowest[1]}), memory {_memory_mb() - before:+.0f} MB",
        flush=True,
    )
    return bad


def _memory_mb() -> float:
    """The most this process has ever held."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def keep(folder: Path, name: str, data: bytes, why: str) -> None:
    """The input, and what is wrong with it."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_bytes(data)
    (folder / f"{name}.txt").write_text(why + "\n", encoding="utf-8")
    print(f"{name}: {why.strip().splitlines()[-1]}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
