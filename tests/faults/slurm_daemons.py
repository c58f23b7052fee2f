"""A real Slurm of one node, started in a folder of its own and stopped: munged, slurmctld and
slurmd.
"""

import contextlib
import os
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from faults.runs import FaultError

DAEMONS = ("munged", "slurmctld", "slurmd")
START_SECONDS, STOP_SECONDS, POLL_SECONDS = 60.0, 15.0, 0.1
KEY_BYTES = 128
# munge and slurmd look at who else may write where they keep things
OPEN_FOLDER = 0o755
# accounts need a database daemon, control groups a systemd: neither is needed to run jobs
SETTINGS = """\
ClusterName=headstock
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller_port}
SlurmdPort={node_port}
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket,cred_expire=3
CredType=cred/munge
MpiDefault=none
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SlurmdParameters=config_overrides
SchedulerParameters=sched_interval=2,sched_min_interval=100000,bf_interval=2
ReturnToService=2
KillWait=3
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""
CONTROL_GROUPS = "CgroupPlugin=disabled\n"


@contextlib.contextmanager
def run_slurm(folder: Path, *, cpus: int) -> Iterator[dict[str, str]]:
    """Start Slurm and stop it at the end, whatever happens.

    Args:
        folder: Empty, for settings, sockets and logs.
        cpus: The node is said to have; more than there are lets tasks run side by side.

    Yields:
        Variables with which programs find this Slurm.

    Raises:
        FaultError: A daemon does not start; its last words are told.
    """
    _write_settings(folder, cpus)
    variables = {"SLURM_CONF": str(folder / "slurm.conf")}
    munge = [
        f"--{name}={folder}/munge.{name.removesuffix('-file')}"
        for name in ("key-file", "pid-file", "log-file", "seed-file")
    ]
    commands = {
        "munged": ["munged", "--foreground", f"--socket={folder}/munge.socket", *munge],
        "slurmctld": ["slurmctld", "-D", "-i"],
        "slurmd": ["slurmd", "-D"],
    }
    started: dict[str, subprocess.Popen[bytes]] = {}
    try:
        for name, words in commands.items():
            with (folder / f"{name}.out").open("wb") as output:
                started[name] = subprocess.Popen(
                    words,
                    env={**os.environ, **variables},
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=output,
                )
            if name == "munged":
                _wait_until(folder, started, lambda: (folder / "munge.socket").exists())
        _wait_until(folder, started, lambda: _node_is_idle(variables))
        yield variables
    finally:
        _stop(started)


def _write_settings(folder: Path, cpus: int) -> None:
    for name in (".", "state", "spool"):
        (folder / name).mkdir(exist_ok=True)
        (folder / name).chmod(OPEN_FOLDER)
    host = socket.gethostname().partition(".")[0]
    channels = _free_ports(2)
    settings = SETTINGS.format(
        host=host, folder=folder, cpus=cpus, controller_port=channels[0], node_port=channels[1]
    )
    (folder / "slurm.conf").write_text(settings)
    (folder / "cgroup.conf").write_text(CONTROL_GROUPS)
    key = folder / "munge.key"
    key.touch(0o600)
    key.write_bytes(os.urandom(KEY_BYTES))


def _free_ports(count: int) -> list[int]:
    with contextlib.ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(count)]
        for found in sockets:
            found.bind(("127.0.0.1", 0))
        return [found.getsockname()[1] for found in sockets]


def _node_is_idle(variables: dict[str, str]) -> bool:
    done = subprocess.run(
        ["sinfo", "--noheader", "--format=%T"],
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
        timeout=START_SECONDS,
    )
    return done.returncode == 0 and done.stdout.strip() == "idle"


def _wait_until(
    folder: Path, started: dict[str, "subprocess.Popen[bytes]"], is_ready: Callable[[], bool]
) -> None:
    end = time.monotonic() + START_SECONDS
    while not is_ready():
        for name, process in started.items():
            if process.poll() is not None or time.monotonic() > end:
                said = (folder / f"{name}.out").read_text(errors="replace").strip()[-1500:]
                raise FaultError(f"{name} does not start (exit code {process.poll()}): {said}")
        time.sleep(POLL_SECONDS)


def _stop(started: dict[str, "subprocess.Popen[bytes]"]) -> None:
    for process in reversed(started.values()):
        process.terminate()
        try:
            process.wait(STOP_SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
