"""Ray clusters of several machines, as people start them: here raylets of one machine."""

import os
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

import sweep_works
from frida_painter.lab.sweeps.engine import RayEngine, TaskLimits

pytest.importorskip("ray", reason="Ray is not installed; say: pip install '.[ray]'")
pytestmark = pytest.mark.slow
LIMITS = TaskLimits(60.0, memory=100)
JOINING = """
import sys
from frida_painter.errors import ConfigError
from frida_painter.lab.sweeps.engine import TaskLimits
from frida_painter.lab.sweeps.engine import RayEngine
import sweep_works

try:
    engine = RayEngine(TaskLimits(60.0, memory=100), 1, sys.argv[1])
    print(sorted(ended.value for ended in engine.run(sweep_works.square, range(4))))
except ConfigError as error:
    print(error)
"""


@pytest.fixture(autouse=True)
def _found_by_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes of Ray find `sweep_works` as this one does."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(path for path in sys.path if path))


def test_a_machine_that_is_gone_in_the_middle_costs_no_result(capfd) -> None:
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    try:
        lost = cluster.add_node(num_cpus=1)
        found: dict[int, str] = {}
        for ended in RayEngine(LIMITS, 1, cluster.address).run(sweep_works.node, range(20)):
            found[ended.task] = ended.value
            if len(set(found.values())) == 2 and lost is not None:
                cluster.remove_node(lost, allow_graceful=False)
                lost = None
        assert lost is None, "both machines took part"
        assert sorted(found) == list(range(20)) and all(found.values())
    finally:
        cluster.shutdown()
    assert "Traceback" not in capfd.readouterr().err


@contextmanager
def started_by_hand(home: Path) -> Iterator[str]:
    """The address of a cluster that `ray start --head` starts for a person with that home."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    program = str(shutil.which("ray", path=str(Path(sys.executable).parent)))
    environment = {**os.environ, "HOME": str(home)}
    subprocess.run([program, "get-auth-token", "--generate"], env=environment, check=True, capture_output=True)
    command = [program, "start", "--head", "--block", "--node-ip-address=127.0.0.1"]
    command += [f"--port={address.rpartition(':')[2]}", "--num-cpus=1"]
    command += ["--include-dashboard=false", "--disable-usage-stats", "--object-store-memory=100000000"]
    with subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    ) as head:
        assert head.stdout is not None
        try:
            said = []
            while not any("Ray runtime started" in line for line in said):
                said.append(head.stdout.readline())
                assert said[-1], f"it ended: {said}"
            yield address
        finally:
            head.send_signal(signal.SIGTERM)
            with suppress(subprocess.TimeoutExpired):
                head.wait(60)
            with suppress(ProcessLookupError):
                os.killpg(head.pid, signal.SIGKILL)


def joined(address: str, home: Path) -> tuple[str, int]:
    """What another program of a person with that home says of the cluster, and its exit status."""
    environment = {**os.environ, "HOME": str(home)}
    done = subprocess.run(
        [sys.executable, "-c", JOINING, address], env=environment, capture_output=True, text=True, timeout=120
    )
    return done.stdout.strip(), done.returncode


def test_a_cluster_that_was_started_by_hand_is_joined_with_its_token(tmp_path) -> None:
    """Ray asks for the token of the person who started it."""
    at_home, stranger = tmp_path / "home", tmp_path / "stranger"
    at_home.mkdir()
    stranger.mkdir()
    with started_by_hand(at_home) as address:
        assert joined(address, at_home) == ("[0, 1, 4, 9]", 0)
        refused, status = joined(address, stranger)
    if refused:
        assert "cannot be joined" in refused and "ray get-auth-token" in refused and "\n" not in refused
    else:  # on a busy machine Ray ends the process of whom it does not let in before that is known here
        assert status != 0
