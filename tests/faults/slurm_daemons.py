"""A real Slurm of one or more nodes on this machine, started in a folder of its own and stopped:
munged, slurmctld and a slurmd per node.
"""

import contextlib
import os
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from common import run_process
from faults.runs import FaultError

DAEMONS = ("munged", "slurmctld", "slurmd")
START_SECONDS, STOP_SECONDS, POLL_SECONDS = 60.0, 15.0, 0.1
# after which a node that does not answer counts as failed
SILENT_SECONDS = 10
KEY_BYTES = 128
# munge and slurmd look at who else may write where they keep things
OPEN_FOLDER = 0o755
# accounts need a database daemon, control groups a systemd: neither is needed to run jobs
SETTINGS = """\
ClusterName=headstock
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller_port}
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket,cred_expire=5
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
SlurmdSpoolDir={folder}/spool-%n
TmpFS={folder}/tmp-%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
SlurmdTimeout={silent_seconds}
{nodes}
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""
CONTROL_GROUPS = "CgroupPlugin=disabled\n"


@dataclass
class Slurm:
    """Daemons that run.

    Attributes:
        variables: With which programs find this Slurm.
    """

    folder: Path
    variables: dict[str, str]
    _daemons: dict[str, "subprocess.Popen[bytes]"] = field(default_factory=dict)

    def start(self, name: str, *words: str) -> None:
        """Start a daemon; what it says goes into a file of its name."""
        with (self.folder / f"{name}.out").open("wb") as output:
            self._daemons[name] = subprocess.Popen(
                words,
                env={**os.environ, **self.variables},
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
            )

    def start_node(self, node: str) -> None:
        """Start the daemon of a node; what was left of a failed one is gone with it."""
        self._signal_node(node, signal.SIGKILL)
        self.start(f"slurmd-{node}", "slurmd", "-D", "-N", node)

    def fail_node(self, node: str) -> None:
        """A node fails as by a power cut: its daemon is killed, and nothing it has started says
        another word.
        """
        daemon = self._daemons.pop(f"slurmd-{node}")
        daemon.kill()
        daemon.wait()
        self._signal_node(node, signal.SIGSTOP)

    def _signal_node(self, node: str, number: signal.Signals) -> None:
        for process in _of_node(node, self.variables["SLURM_CONF"]):
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, number)

    def wait_until_idle(self) -> None:
        """Wait until every node waits for jobs."""
        self.wait_until(lambda: self.node_states() == {"idle"})

    def node_states(self) -> set[str]:
        """States of the nodes, as Slurm names them; empty while it does not answer."""
        command = ["sinfo", "--noheader", "--Node", "--format=%T"]
        variables = {**os.environ, **self.variables}
        done = run_process(command, env=variables, timeout=START_SECONDS)
        return set(done.stdout.split()) if done.returncode == 0 else set()

    def wait_until(self, is_ready: Callable[[], bool]) -> None:
        """Wait, as long as all daemons live."""
        end = time.monotonic() + START_SECONDS
        while not is_ready():
            for name, process in self._daemons.items():
                if process.poll() is not None or time.monotonic() > end:
                    text = (self.folder / f"{name}.out").read_text(errors="replace").strip()
                    raise FaultError(
                        f"{name} does not start (exit code {process.poll()}): {text[-1500:]}"
                    )
            time.sleep(POLL_SECONDS)

    def stop(self) -> None:
        """End all daemons, the last to start first."""
        for process in reversed(self._daemons.values()):
            process.terminate()
            try:
                process.wait(STOP_SECONDS)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@contextlib.contextmanager
def run_slurm(folder: Path, *, cpus: int, nodes: Sequence[str] = ()) -> Iterator[Slurm]:
    """Start Slurm and stop it at the end, whatever happens."""
    nodes = nodes or (_host(),)
    _write_settings(folder, cpus, nodes)
    slurm = Slurm(folder, {"SLURM_CONF": str(folder / "slurm.conf")})
    munge = [
        f"--{name}={folder}/munge.{name.removesuffix('-file')}"
        for name in ("key-file", "pid-file", "log-file", "seed-file")
    ]
    try:
        slurm.start("munged", "munged", "--foreground", f"--socket={folder}/munge.socket", *munge)
        slurm.wait_until((folder / "munge.socket").exists)
        slurm.start("slurmctld", "slurmctld", "-D", "-i")
        for node in nodes:
            slurm.start_node(node)
        slurm.wait_until_idle()
        yield slurm
    finally:
        slurm.stop()


def _host() -> str:
    return socket.gethostname().partition(".")[0]


def _of_node(node: str, settings: str) -> Iterator[int]:
    """Daemons of the job steps on a node, and what they have started."""
    own = f"SLURMD_NODENAME={node}".encode()
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            variables = (folder / "environ").read_bytes().split(b"\0")
            if own in variables and f"SLURM_CONF={settings}".encode() in variables:
                yield int(folder.name)


def _write_settings(folder: Path, cpus: int, nodes: Sequence[str]) -> None:
    # PMIx of a job step makes folders of its number in TmpFS
    for name in (".", "state", *(f"{kind}-{node}" for kind in ("spool", "tmp") for node in nodes)):
        (folder / name).mkdir(exist_ok=True)
        (folder / name).chmod(OPEN_FOLDER)
    controller_port, *ports = _free_ports(1 + len(nodes))
    settings = SETTINGS.format(
        host=_host(),
        folder=folder,
        controller_port=controller_port,
        silent_seconds=SILENT_SECONDS,
        nodes="\n".join(
            f"NodeName={node} NodeHostname={_host()} NodeAddr=127.0.0.1 Port={port} CPUs={cpus} State=UNKNOWN"
            for node, port in zip(nodes, ports, strict=True)
        ),
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
