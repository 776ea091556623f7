"""The twin's server in lock-step with a kinematic arm, driven by pylibfranka: medians.

python -m tests.benchmarks.bench_fci [--json]

Ticks a second of the wall clock mean something on an otherwise idle machine only; beside them
stand those of the median tick, and the CPU time that server and client need for one.
"""

import argparse
import json
import subprocess
import sys
import time
from statistics import median

from drivers.fci_server.server import RobotServer

CONNECTIONS, ROUNDS, TICKS = 15, 7, 4000
TICKS_BAR, CONNECT_BAR = 3000.0, 0.2  # 1/s, s


def measure() -> dict[str, float]:
    numbers = [str(number) for number in (CONNECTIONS, ROUNDS, TICKS)]
    with RobotServer() as server:
        command = [sys.executable, "-m", "tests.benchmarks.fci_client", server.address, *numbers]
        cpu = time.process_time()
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        cpu = time.process_time() - cpu  # of this process, which does nothing but serve
    told = json.loads(done.stdout.splitlines()[-1])
    walls = [one["wall"] for one in told["rounds"]]
    return {
        "ticks_per_second": 1 / median(walls),
        "ticks_per_second_of_median_tick": 1 / median(one["median"] for one in told["rounds"]),
        "server_cpu_us": 1e6 * cpu / (ROUNDS * TICKS),
        "client_cpu_us": 1e6 * median(one["cpu"] for one in told["rounds"]),
        "connect_ms": 1e3 * median(told["connect"]),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    found = measure()
    if parser.parse_args().json:
        print(json.dumps(found))
        return
    print(
        f"lock-step: {found['ticks_per_second']:.0f} ticks/s median of {ROUNDS} rounds, "
        f"{found['ticks_per_second_of_median_tick']:.0f} of the median tick (bar {TICKS_BAR:.0f})"
    )
    print(f"CPU a tick: server {found['server_cpu_us']:.0f} us, client", end=" ")
    print(f"{found['client_cpu_us']:.0f} us")
    print(f"connect: {found['connect_ms']:.1f} ms median (bar {1e3 * CONNECT_BAR:.0f} ms)")


if __name__ == "__main__":
    main()
