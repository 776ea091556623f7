"""A client's hand: open, grasp what is there, say what it feels, be refused
nonsense.
"""

import json
import sys

address, module = sys.argv[1:]
told: dict[str, object] = {}
if module == "pylibfranka":
    import pylibfranka

    hand = pylibfranka.Gripper(address)
elif module == "franky":
    import franky

    hand = franky.Gripper(address)
else:
    import franka

    hand = franka.Robot(address, realtime="ignore").gripper()

told["homed"] = hand.homing()
told["opened"] = hand.move(0.06, 0.1)
told["grasped"] = hand.grasp(0.02, 0.1, 20.0, epsilon_inner=0.005, epsilon_outer=0.005)
state = hand.state if module == "franky" else hand.read_once()
told["width"], told["holds"] = state.width, bool(state.is_grasped)
told["missed"] = hand.grasp(0.05, 0.1, 20.0, epsilon_inner=0.005, epsilon_outer=0.005)
told["stopped"] = hand.stop()
try:
    told["wide"] = hand.move(0.5, 0.1)
except Exception as error:  # noqa: BLE001 - each library has errors of its own
    told["wide"] = type(error).__name__
print(json.dumps(told))
