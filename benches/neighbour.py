"""A neighbour on another processor: streams through more memory than the caches hold.

Others do that on a shared machine.

    python benches/neighbour.py 60 & python benches/peers/compare.py J1 LS tracker; wait

It stops after that many seconds.
"""

from __future__ import annotations

import argparse
import os
import time

import numpy as np

SIZE = 1 << 24


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("seconds", type=float)
    end = time.monotonic() + parser.parse_args().seconds
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    numbers = np.zeros(SIZE)
    while time.monotonic() < end:
        numbers += 1.0


if __name__ == "__main__":
    main()
