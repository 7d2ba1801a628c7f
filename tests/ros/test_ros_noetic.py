"""Robots that run ROS Noetic understand us: types are compared by their md5 sums when two nodes connect.

The sums are those of Noetic's packages (common_msgs 1.13, std_msgs 0.5, navigation_msgs 1.14, geometry2 0.7,
dynamic_reconfigure 1.7), as rosmsg md5 and rossrv md5 print them there; they also stand in the headers that rosserial
and other generators made of the same definitions."""

import ast
import importlib
import re
from pathlib import Path

import pytest
from rosbags.typesys import Stores, TypesysError, get_typestore

pytest.importorskip("rospy")

from vsx_ros.ros import topics

SOURCES = Path(__file__).resolve().parents[2] / "src/vsx_ros"
NOETIC = {
    "actionlib_msgs/GoalID": "302881f31927c1df708a2dbab0e80ee8",
    "actionlib_msgs/GoalStatus": "d388f9b87b3c471f784434d671988d4a",
    "actionlib_msgs/GoalStatusArray": "8b2b82f13216d0a8ea88bd3af735e619",
    "diagnostic_msgs/AddDiagnostics": "e6ac9bbde83d0d3186523c3687aecaee",
    "diagnostic_msgs/DiagnosticArray": "60810da900de1dd6ddd437c3503511da",
    "diagnostic_msgs/DiagnosticStatus": "d0ce08bc6e5ba34c7754f563a9cabaf1",
    "diagnostic_msgs/KeyValue": "cf57fdc6617a881a88c16e768132149c",
    "dynamic_reconfigure/Config": "958f16a05573709014982821e6822580",
    "dynamic_reconfigure/ConfigDescription": "757ce9d44ba8ddd801bb30bc456f946f",
    "dynamic_reconfigure/Reconfigure": "bb125d226a21982a4a98760418dc2672",
    "geometry_msgs/Point": "4a842b65f413084dc2b10fb484ea7f17",
    "geometry_msgs/Pose": "e45d45a5a1ce597b249e23fb30fc871f",
    "geometry_msgs/PoseArray": "916c28c5764443f268b296bb671b9d97",
    "geometry_msgs/PoseStamped": "d3812c3cbc69362b77dc0b19b345f8f5",
    "geometry_msgs/PoseWithCovarianceStamped": "953b798c0f514ff060a53a3498ce6246",
    "geometry_msgs/Quaternion": "a779879fadf0160734f906b8c19c7004",
    "geometry_msgs/Transform": "ac9eff44abf714214112b05d54a3cf9b",
    "geometry_msgs/TransformStamped": "b5764a33bfeb3588febc2682852579b0",
    "geometry_msgs/Twist": "9f195f881246fdfa2798d1d3eebca84a",
    "geometry_msgs/Vector3": "4a842b65f413084dc2b10fb484ea7f17",
    "move_base_msgs/MoveBaseAction": "70b6aca7c7f7746d8d1609ad94c80bb8",
    "move_base_msgs/MoveBaseActionFeedback": "7d1870ff6e0decea702b943b5af0b42e",
    "move_base_msgs/MoveBaseActionGoal": "660d6895a1b9a16dce51fbdd9a64a56b",
    "move_base_msgs/MoveBaseActionResult": "1eb06eeff08fa7ea874431638cb52332",
    "move_base_msgs/MoveBaseFeedback": "3fb824c456a757373a226f6d08071bf0",
    "move_base_msgs/MoveBaseGoal": "257d089627d7eb7136c24d3593d05a16",
    "nav_msgs/GetMap": "6cdd0a18e0aff5b0a3ca2326a89b54ff",
    "nav_msgs/GetPlan": "421c8ea4d21c6c9db7054b4bbdf1e024",
    "nav_msgs/MapMetaData": "10cfc8a2818024d3248802c00c95f11b",
    "nav_msgs/OccupancyGrid": "3381f2d731d4076ec5c71b0759edbe4e",
    "nav_msgs/Odometry": "cd5e73d190d741a2f92e81eda573aca7",
    "nav_msgs/Path": "6227e2b7e9cce15051f669a5e197bbf7",
    "rosgraph_msgs/Clock": "a9c97c1d230cfc112e270351a944ee47",
    "rosgraph_msgs/Log": "acffd30cd6b6de30f120938c17c593fb",
    "sensor_msgs/BatteryState": "4ddae7f048e32fda22cac764685e3974",
    "sensor_msgs/CameraInfo": "c9a58c1b0b154e0e6da7578cb991d214",
    "sensor_msgs/CompressedImage": "8f7a12909da2c9d3332d540a0977563f",
    "sensor_msgs/Image": "060021388200f6f0f447d0fcd9c64743",
    "sensor_msgs/Imu": "6a62c6daae103f4ff57a132d6f95cec2",
    "sensor_msgs/JointState": "3066dcd76a6cfaef579bd0f34173e9fd",
    "sensor_msgs/LaserScan": "90c7ef2dc6895d81024acba2ac42f369",
    "sensor_msgs/PointCloud2": "1158d486dd51d683ce2f1be655c3c181",
    "sensor_msgs/PointField": "268eacb2962780ceac86cbd17e328150",
    "sensor_msgs/SetCameraInfo": "bef1df590ed75ed1f393692395e15482",
    "std_msgs/Bool": "8b94c1b53db61fb6aed406028ad6332a",
    "std_msgs/ColorRGBA": "a29a96539573343b1310c73607334b00",
    "std_msgs/Float32": "73fcbf46b49191e672908e50842a83d4",
    "std_msgs/Float64MultiArray": "4b7d974086d4060e7db4613a7e6c3ba4",
    "std_msgs/Header": "2176decaecbce78abc3b96ef049fabed",
    "std_msgs/MultiArrayDimension": "4cd0c83a8683deae40ecdac60e53bfa8",
    "std_msgs/MultiArrayLayout": "0fed2a11c13e11c5571b4e2a995a91a3",
    "std_msgs/String": "992ce8a1687cec8c8bd883ec73ca41d1",
    "std_msgs/UInt32": "304a39449588c7f8ce2df6e8001c5fce",
    "std_msgs/UInt8": "7c8164229e7d2c17eb95e9231617fdee",
    "std_msgs/UInt8MultiArray": "82373f1612381bb6ee473b5cd6f5d89c",
    "std_srvs/SetBool": "09fb03525b03e7ea1fd3992bafd87e16",
    "std_srvs/Trigger": "937c9679a518e3a18d831e57125ea522",
    "tf2_msgs/TFMessage": "94810edda583a504dfda3829e70d7eec",
    "trajectory_msgs/MultiDOFJointTrajectory": "ef145a45a5f47b77b7f5cdde4b16c942",
    "trajectory_msgs/MultiDOFJointTrajectoryPoint": "3ebe08d1abd5b65862d50e09430db776",
    "visualization_msgs/Marker": "4048c9de2a16f4ae8e0538085ebf1b97",
    "visualization_msgs/MarkerArray": "d155b9ce5188fbaf89745847fd5882d7",
}


def used() -> dict[str, type]:
    """Every type of a topic or service, and every other that the sources import, by name."""
    tables = {"msg": topics.PUBLISHED.values(), "srv": topics.SERVICES.values()}
    names = {(kind, name) for kind, table in tables.items() for node in table for name in node.values()}
    for file in SOURCES.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (parts := re.fullmatch(r"(\w+)\.(msg|srv)", node.module or "")):
                ends = r"(Request|Response)$" if parts[2] == "srv" else "$"
                names |= {(parts[2], f"{parts[1]}/{re.sub(ends, '', alias.name)}") for alias in node.names}
    found = {}
    for kind, name in names:
        package, _, short = name.partition("/")
        found[name] = getattr(importlib.import_module(f"{package}.{kind}"), short)
    return found


def test_messages_and_services_are_noetic_s() -> None:
    assert {name: kind._md5sum for name, kind in used().items()} == NOETIC


def test_the_sums_are_those_of_another_reader_of_noetic_s_definitions() -> None:
    store, compared = get_typestore(Stores.ROS1_NOETIC), 0
    for name, md5 in NOETIC.items():
        try:
            _, sum_of_definition = store.generate_msgdef(name.replace("/", "/msg/"), ros_version=1)
        except TypesysError:  # a service, or a package that it leaves out
            continue
        assert sum_of_definition == md5, name
        compared += 1
    assert compared > 40
