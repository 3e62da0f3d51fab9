"""Processes that write to a store until they are killed.

``python writing.py ADDRESS`` writes without end and prints a line for each change that is stored; with ``KILLS SEED``
it starts so many writers, one after the other, kills each at a random moment, and prints what they printed.
"""

from __future__ import annotations

import itertools
import os
import random
import signal
import sys
import time

from truepose.store import records
from truepose.store.store import Store

MOMENT = 0.05
"""Writers are killed within so many seconds [s] of their first change: in the middle of one of the next."""


def write(address: str) -> None:
    with Store.open(address) as store:
        for i in itertools.count():
            name = f"{os.getpid()}-{i}"
            with store.transaction("writer") as change:
                cell = records.put_cell(change, name, name.encode())
                records.put_map(change, records.NewMap(cell, "m", f"map {name}".encode(), "idw", {"n": i}))
            os.write(1, f"{change.head.sequence} {change.head.hash}\n".encode())


def kill_one(address: str, moments: random.Random) -> bytes:
    """Fork a writer, which has nothing to import any more, and kill it; return what it printed."""
    read, out = os.pipe()
    if (writer := os.fork()) == 0:
        os.dup2(out, 1)
        write(address)
    os.close(out)
    with os.fdopen(read, "rb") as lines:
        first = lines.readline()
        time.sleep(moments.uniform(0, MOMENT))
        os.kill(writer, signal.SIGKILL)
        rest = lines.read()
    os.waitpid(writer, 0)
    return first + rest


if __name__ == "__main__":
    if len(sys.argv) == 2:
        write(sys.argv[1])
    address, kills, seed = sys.argv[1:]
    Store.open(address).close()  # the driver and all else that opening a store imports; no connection is inherited
    moments = random.Random(int(seed))
    for _ in range(int(kills)):
        os.write(1, kill_one(address, moments))
