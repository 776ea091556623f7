"""A program that works with a longer tool and 1 kg, and leaves both to whoever comes
next.
"""

import sys

import pylibfranka

robot = pylibfranka.Robot(sys.argv[1], pylibfranka.RealtimeConfig.kIgnore)
longer = [1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0.05, 1.0]
robot.set_EE(longer)
robot.set_load(1.0, [0.0, 0.0, 0.1], [1e-3, 0, 0, 0, 1e-3, 0, 0, 0, 1e-3])
print("{}")
