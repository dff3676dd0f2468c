"""The message types of ROS 2 that a recording is converted to, as their packages define them.

A definition is followed by those that it is made of. The hashes are of REP 2011; they are the same
in all releases from Humble on.
"""

from dataclasses import dataclass

_TIME = """\
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
_HEADER = """\
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
"""


@dataclass(frozen=True, slots=True)
class RosType:
    """A message type: its full name, its definition and its hash."""

    name: str
    definition: str
    hash: str


def _joined(*definitions: str) -> str:
    return f"{'=' * 80}\n".join(definitions)


JOINT_STATE = RosType(
    "sensor_msgs/msg/JointState",
    _joined(
        """\
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
""",
        _HEADER,
        _TIME,
    ),
    "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
)
TF = RosType(
    "tf2_msgs/msg/TFMessage",
    _joined(
        "geometry_msgs/TransformStamped[] transforms\n",
        """\
MSG: geometry_msgs/TransformStamped
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
""",
        _HEADER,
        _TIME,
        """\
MSG: geometry_msgs/Transform
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
""",
        """\
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
""",
        """\
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
""",
    ),
    "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
)
STRING = RosType(
    "std_msgs/msg/String",
    "string data\n",
    "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
)
LOG = RosType(
    "rcl_interfaces/msg/Log",
    _joined(
        """\
byte DEBUG=10
byte INFO=20
byte WARN=30
byte ERROR=40
byte FATAL=50
builtin_interfaces/Time stamp
uint8 level
string name
string msg
string file
string function
uint32 line
""",
        _TIME,
    ),
    "RIHS01_e28ce254ca8abc06abf92773b74602cdbf116ed34fbaf294fb9f81da9f318eac",
)
INFO, WARN = 20, 30
