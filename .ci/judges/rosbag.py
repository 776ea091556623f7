"""The library `rosbags` records the gripper's path as joint states, in a rosbag2
folder.

    python .ci/judges/rosbag.py OURS

The names of the parts change places from message to message, as ROS allows.
"""

import sys
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

OURS = Path(sys.argv[1])
store = get_typestore(Stores.ROS2_JAZZY)
names = ("std_msgs/msg/Header", "builtin_interfaces/msg/Time")
Header, Time = (store.types[name] for name in names)
JointState = store.types["sensor_msgs/msg/JointState"]

with Writer(OURS / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
    kind = JointState.__msgtype__
    topic = bag.add_connection("/tip", kind, typestore=store)
    for number, (t, x, z) in enumerate(np.load(OURS / "path.npy").T):
        stamp = round(1e9 * (t + 100.0))
        parts = {"along": x, "up": z} if number % 2 else {"up": z, "along": x}
        header = Header(Time(*divmod(stamp, 10**9)), "cell")
        none = np.zeros(0)
        state = JointState(header, [*parts], np.array([*parts.values()]), none, none)
        bag.write(topic, stamp, store.serialize_cdr(state, kind))
