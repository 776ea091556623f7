"""A client that a server of another version turns away: what its library says."""

import json
import sys

address, module = sys.argv[1:]
try:
    if module == "pylibfranka":
        import pylibfranka

        pylibfranka.Robot(address, pylibfranka.RealtimeConfig.kIgnore)
    elif module == "franky":
        import franky

        franky.Robot(address, realtime_config=franky.RealtimeConfig.Ignore)
    else:
        import franka

        franka.Robot(address, realtime="ignore")
    said = "connected"
except Exception as error:  # noqa: BLE001 - each library has errors of its own
    said = f"{type(error).__name__}: {error}"
print(json.dumps({"said": said}))
