"""Which name a client gives to each of the 41 error flags; the robot's time says which
is set.
"""

import json
import sys

FLAGS, WINDOW = 41, 10  # ms a flag


def states_of(module: str, address: str):
    if module == "pylibfranka":
        import pylibfranka

        robot = pylibfranka.Robot(address, pylibfranka.RealtimeConfig.kIgnore)
        while True:
            state = robot.read_once()
            errors = state.current_errors
            set_ones = [name for name in dir(errors) if getattr(errors, name) is True]
            yield round(1000 * state.time.to_sec()), set_ones
    import franka

    robot = franka.Robot(address, realtime="ignore")
    while True:
        state = robot.read_once()
        yield round(1000 * state.time), state.current_errors


names: dict[int, list[str]] = {}
for time, named in states_of(sys.argv[2], sys.argv[1]):
    if time % WINDOW == WINDOW // 2:
        names[time // WINDOW % FLAGS] = [name.lower() for name in named]
    if len(names) == FLAGS:
        break
print(json.dumps({"names": [names[flag] for flag in range(FLAGS)]}))
