"""The arm's node for a real ROS 1 master, run by the system's own Python: usage: ros_arm_node.py MISBEHAVIOUR."""

import sys
from pathlib import Path
from typing import Any

import genpy.message
import rospy
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from std_msgs.msg import Empty
from trajectory_msgs.msg import MultiDOFJointTrajectory

sys.path.insert(0, str(Path(__file__).parents[1]))
from machines.ros_arm import RosArm


def as_mapping(message: Any) -> Any:
    if hasattr(message, "secs"):
        return {"secs": message.secs, "nsecs": message.nsecs}
    if hasattr(message, "_type"):
        return {name: as_mapping(getattr(message, name)) for name in message.__slots__}
    return [as_mapping(part) for part in message] if isinstance(message, (list, tuple)) else message


rospy.init_node("arm")
topics = {
    "/brush/pose": rospy.Publisher("/brush/pose", PoseStamped, queue_size=1),
    "/brush/status": rospy.Publisher("/brush/status", GoalStatus, queue_size=10),
}


def tell(topic: str, message: dict[str, Any]) -> None:
    made = topics[topic].data_class()
    genpy.message.fill_message_args(made, [message])
    if not rospy.is_shutdown():
        topics[topic].publish(made)


arm = RosArm(tell, pace=20.0, ros=1)
arm.misbehave = sys.argv[1]
rospy.Subscriber("/brush/follow", MultiDOFJointTrajectory, lambda said: arm.hear("/brush/follow", as_mapping(said)))
rospy.Subscriber("/brush/alive", Empty, lambda said: arm.hear("/brush/alive", {}))
rospy.Subscriber("/brush/stop", Empty, lambda said: arm.hear("/brush/stop", {}))
arm.start()
rospy.spin()
arm.end()
