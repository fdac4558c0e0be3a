"""An exported package with the ROS of this machine; skipped unless one is sourced and colcon is there.

    source /opt/ros/humble/setup.bash && .venv/bin/pytest tests/ros

Two nodes are built, loaded, run for ten seconds and stopped as by Ctrl-C. With ``ros2 trace`` installed, its trace is
compared with the schedule, too.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not os.environ.get("ROS_DISTRO") or not shutil.which("colcon"),
        reason="no ROS is sourced, or colcon is not there",
    ),
]
HERE = Path(__file__).parent
CMAKE = """\
cmake_minimum_required(VERSION 3.16)
project(halpipe_probe CXX)
set(CMAKE_CXX_STANDARD 17)
find_package(ament_cmake REQUIRED)
find_package(rclcpp REQUIRED)
find_package(rclcpp_components REQUIRED)
find_package(std_msgs REQUIRED)
find_package(std_srvs REQUIRED)
add_library(nodes SHARED nodes.cpp)
ament_target_dependencies(nodes rclcpp rclcpp_components std_msgs std_srvs)
rclcpp_components_register_nodes(nodes "probe::Source" "probe::Sink")
install(TARGETS nodes LIBRARY DESTINATION lib)
ament_package()
"""
PACKAGE = """\
<?xml version="1.0"?>
<package format="3">
  <name>halpipe_probe</name><version>0.1.0</version><description>Probe</description>
  <maintainer email="nobody@example.org">nobody</maintainer><license>MIT</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <depend>rclcpp</depend><depend>rclcpp_components</depend><depend>std_msgs</depend><depend>std_srvs</depend>
  <export><build_type>ament_cmake</build_type></export>
</package>
"""
GRAPH = """\
named_paths: []
executors: []
nodes:
- node_name: /source
  callbacks: [{callback_name: /source/tick, callback_type: timer_callback, period_ns: 20000000, symbol: t}]
  publishes: [{topic_name: /x, callback_names: [/source/tick]}]
- node_name: /sink
  callbacks: [{callback_name: /sink/take, callback_type: subscription_callback, topic_name: /x, symbol: s}]
  subscribes: [{topic_name: /x, callback_name: /sink/take}]
"""
OVERLAY = """\
halpipe-overlay: 1
platform: {units: [{name: c0}, {name: c1}]}
tasks: {"*": {wcet: 2ms, units: ["c*"]}}
chains: [{name: xs, tasks: [/source, /sink], max-age: 30ms}]
"""
LONGEST = 50_000_000
"""Limit of the age, plus a period of the first task."""


def halpipe(*arguments, code=0):
    ran = subprocess.run([sys.executable, "-m", "halpipe", *arguments], capture_output=True, text=True, check=False)
    assert ran.returncode in (code, 0), ran.stderr
    return ran.stdout + ran.stderr


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    """A workspace with the nodes and the exported package, built."""
    folder = tmp_path_factory.mktemp("ws")
    probe = folder / "src" / "halpipe_probe"
    probe.mkdir(parents=True)
    shutil.copy(HERE / "nodes.cpp", probe)
    (probe / "CMakeLists.txt").write_text(CMAKE)
    (probe / "package.xml").write_text(PACKAGE)
    names = {name: str(folder / name) for name in ("graph.yaml", "overlay.yaml", "model.xml", "schedule.xml")}
    (folder / "graph.yaml").write_text(GRAPH)
    (folder / "overlay.yaml").write_text(OVERLAY)
    tables = folder / "src" / "tables"
    halpipe("import", "ros", names["graph.yaml"], "--overlay", names["overlay.yaml"], "-o", names["model.xml"])
    halpipe("schedule", names["model.xml"], "-o", names["schedule.xml"])
    model = (names["model.xml"], names["schedule.xml"], "--package", "--graph", names["graph.yaml"])
    halpipe("export", "ros", *model, "--cpus", "c0=0,c1=1", "-o", str(tables))
    stated = yaml.safe_load((tables / "config" / "components.yaml").read_text())
    for one in stated["components"]:
        one |= {"package": "halpipe_probe", "plugin": "probe::Source" if one["node"] == "/source" else "probe::Sink"}
    stated["container"] |= {"record": str(folder / "run.csv"), "priority": 0}
    (tables / "config" / "components.yaml").write_text(yaml.safe_dump(stated))
    subprocess.run(["colcon", "build"], cwd=folder, check=True)
    return folder


def test_the_nodes_follow_their_table_and_end_as_they_should(workspace):
    package = re.search("<name>(.*)</name>", (workspace / "src" / "tables" / "package.xml").read_text())[1]
    command = f"source install/setup.bash && exec ros2 launch {package} tables.launch.py"
    launch = subprocess.Popen(
        ["bash", "-c", command], cwd=workspace, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    call = "source install/setup.bash && sleep 10 && ros2 service call /sink/oldest std_srvs/srv/Trigger"
    asked = subprocess.run(["bash", "-c", call], cwd=workspace, capture_output=True, text=True, timeout=60, check=False)
    launch.send_signal(signal.SIGINT)
    said = launch.communicate(timeout=60)[0]
    assert not re.search(r"process has died .*exit code (?!3\b)", said), (
        said
    )  # 3: jobs were late, or the first had no message
    oldest = int(re.search(r"message='(\d+)'", asked.stdout)[1])
    assert 0 < oldest <= LONGEST, said
    compared = halpipe(
        "compare", str(workspace / "schedule.xml"), str(workspace / "run.csv"), "--tolerance", "20ms", code=1
    )
    assert "HAL1108" not in compared  # a job that did not run
    assert "HAL1109" not in compared  # a job that is not in the table
    assert compared.count("HAL1115") <= 1  # the first job may have had no message
