"""The launcher, run under a plain shell with stand-ins for the tools that build and enter the
private root.
"""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from common import Done, run_process

ROOT = Path(__file__).resolve().parent.parent.parent
SLURM_TESTS = "tests/faults/test_slurm.py"

TOOLS = """
    awk basename cat chmod cksum cp cut date df dirname env find flock grep head id kill ln ls mkdir mv nproc readlink rm sed
    mkfifo setsid sh sha256sum sleep sort stat tail tar tr touch true uname
""".split()  # noqa: SIM905

# makes the tree that mmdebstrap would make: in the folder it is given, or as a tar stream for an
# ordinary user
MMDEBSTRAP = """#!/bin/sh
echo $$ >"{pid}"
echo "$@" | tr "\\n" " " >>"{log}"
echo >>"{log}"
sleep {seconds}
while [ "$1" != trixie ]; do shift; done
[ {code} = 0 ] || {{ echo "E: no such mirror" >&2; exit {code}; }}
tree=$2
[ "$tree" != - ] || tree=$(mktemp -d)
mkdir -p "$tree/usr/bin" "$tree/etc" && touch "$tree/usr/bin/python3" && chmod +x "$tree/usr/bin/python3"
[ "$2" != - ] || tar -c -C "$tree" .
"""
BWRAP = 'printf "%s\\n" "$@"'
DF = 'printf "Filesystem 1024-blocks Used Available Capacity Mounted\\nx 1 1 {kb} 1%% /\\n"'


class Host:
    """A machine with just the tools put in its one folder of programs, and a copy of the
    launcher.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.bin = folder / "bin"
        self.cache = folder / "cache"
        self.log = folder / "mmdebstrap.log"
        self.pid = folder / "mmdebstrap.pid"
        self.bin.mkdir()
        for tool in (*TOOLS, "mktemp"):
            found = shutil.which(tool)
            assert found, tool
            (self.bin / tool).symlink_to(found)
        self.write("df", DF.format(kb=9_000_000))
        self.write("bwrap", BWRAP)
        self.mmdebstrap()

    def write(self, tool: str, text: str) -> None:
        """A program: lines of shell, unless another interpreter is named first."""
        (self.bin / tool).unlink(missing_ok=True)
        (self.bin / tool).write_text(text if text.startswith("#!") else f"#!/bin/sh\n{text}\n")
        (self.bin / tool).chmod(0o755)

    def lack(self, tool: str) -> None:
        """Take a tool away, and have nobody install it."""
        (self.bin / tool).unlink()
        self.write("apt-get", "exit 99")

    def mmdebstrap(self, *, seconds: float = 0.0, code: int = 0) -> None:
        self.write(
            "mmdebstrap", MMDEBSTRAP.format(log=self.log, pid=self.pid, seconds=seconds, code=code)
        )

    def ordinary_user(self, *, subordinates: bool = True, namespaces: bool = True) -> None:
        """Run the launcher as somebody who is not root."""
        number = os.geteuid() or 54321
        self.write("id", f"case $1 in -un) echo somebody ;; *) echo {number} ;; esac")
        self.write("newuidmap", "")
        self.write("getsubids", f"exit {0 if subordinates else 1}")
        self.write("unshare", f"exit {0 if namespaces else 1}")

    def environment(self, **more: str) -> dict[str, str]:
        home = self.folder / "home of somebody"
        home.mkdir(exist_ok=True)
        own = {
            "PATH": str(self.bin),
            "HOME": str(home),
            "XDG_CACHE_HOME": str(self.cache),
            "HEADSTOCK_PRIVATE_ROOT": "1",
        }
        return own | more

    def launch(self, line: str, *words: str, cwd: str | Path = ROOT, **more: str) -> Done:
        command: list[str | Path] = [ROOT / "headstock", *shlex.split(line), *words]
        return run(command, self.environment(**more), cwd)

    def enter(self, **more: str) -> Done:
        """The shortest command that needs the root."""
        return self.launch("exec true", **more)

    def plan(self, line: str, *words: str, cwd: str | Path = ROOT, **more: str) -> list[str]:
        """What the launcher would start."""
        done = self.launch(line, *words, cwd=cwd, HEADSTOCK_DRY_RUN="1", **more)
        assert done.returncode == 0, done.stderr
        return done.stdout.splitlines()

    def start(self) -> "subprocess.Popen[str]":
        return subprocess.Popen(
            [ROOT / "headstock", "exec", "true"],
            env=self.environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            # a script that runs the tests in its background has them ignore interrupts, and a shell
            # cannot undo that
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )

    def kept(self, pattern: str = "root-*") -> list[Path]:
        return sorted((self.cache / "headstock").glob(pattern))

    def growing(self) -> list[bool]:
        """Of each root, whether it is still being built."""
        return [".growing." in path.name for path in self.kept()]

    def builds(self) -> int:
        return len(self.log.read_text().splitlines()) if self.log.exists() else 0


def run(command: list[str | Path], environment: Mapping[str, str], cwd: str | Path = ROOT) -> Done:
    return run_process(command, env=environment, cwd=cwd, timeout=60)


@pytest.fixture
def host(tmp_path: Path) -> Host:
    return Host(tmp_path)


def binds(words: list[str], option: str = "--bind") -> dict[str, str]:
    """What is bound, by the place where it is seen."""
    return {words[at + 2]: words[at + 1] for at, word in enumerate(words) if word == option}


def follow(words: list[str], wanted: str) -> bool:
    """Whether words stand one after the other among others."""
    return "\0".join(["", *shlex.split(wanted), ""]) in "\0".join(["", *words, ""])


# ---- the command that is run ----

PROGRAM = "-P -m headstock.app.command_line"
RANK = "/usr/bin/python3 -P -m mpi4py -m headstock.app.command_line"
MPIRUN = "/usr/bin/mpirun --oversubscribe --bind-to none -n"
RAN = "run x.toml --ranks 2"
# what is typed, variables beside it, and words one after the other of what is started
STARTS = {
    "program": ("run 'a b' --set 'k=1 N'", {}, f"/usr/bin/python3 {PROGRAM} run 'a b' --set 'k=1 N'"),
    "ranks": ("run x.toml --ranks 3", {}, f"{MPIRUN} 3 {RANK} run x.toml --ranks 3"),
    "ranks=": ("run x.toml --ranks=3", {}, f"{MPIRUN} 3 {RANK} run x.toml --ranks=3"),
    "rank of Open MPI": (RAN, {"OMPI_COMM_WORLD_SIZE": "2"}, f"{RANK} run"),
    "rank of Slurm": (RAN, {"PMIX_RANK": "2"}, f"{RANK} run"),
    "one node": (RAN, {"SLURM_JOB_NUM_NODES": "1"}, f"{MPIRUN} 2"),
    "tests": ("test -k 'two words'", {}, "/usr/bin/python3 -P -m pytest"),
    "tests at work": ("test -k 'two words'", {}, f"--chdir {ROOT}"),
    "debugger": ("test --pdb", {}, "-n 0"),
}  # fmt: skip


@pytest.mark.parametrize("name", STARTS)
def test_a_command_becomes_a_call_inside_the_root(host: Host, tmp_path: Path, name: str) -> None:
    line, variables, wanted = STARTS[name]
    words = host.plan(line, cwd=tmp_path, **variables)
    assert words[0] == "bwrap" and follow(words, wanted)
    # what the caller wrote stands last
    assert words[-len(shlex.split(line)) + 1 :] == shlex.split(line)[1:]
    assert host.kept() == []


def test_tests_have_workers(host: Host) -> None:
    words = host.plan("test -k x")
    assert int(words[words.index("-n") + 1]) > 0


@pytest.mark.parametrize(
    ("line", "variables"),
    [
        *((f"run x.toml --ranks{count}", {}) for count in (" 1", " many", "", " -2", " 99999")),
        # ranks of a job on a cluster are left to the job, and a rank starts no further ones
        ("sweep x.toml grid --ranks 2 --on slurm", {}),
        ("sweep x.toml grid --on=slurm --ranks=2", {}),
        (RAN, {"OMPI_COMM_WORLD_SIZE": "2"}),
        (RAN, {"PMIX_RANK": "2"}),
        ("run x.toml", {"SLURM_JOB_NUM_NODES": "2"}),
    ],
)
def test_no_mpirun_is_started(host: Host, line: str, variables: dict[str, str]) -> None:
    words = host.plan(line, **variables)
    assert words[0] == "bwrap" and "/usr/bin/mpirun" not in words


def test_top_folders_of_the_host_keep_their_names_and_those_of_the_root_are_its_own(
    host: Host,
) -> None:
    words = host.plan("doctor")
    assert "/tmp" in binds(words)
    assert set(binds(words)) & {"/", "/usr", "/etc", "/bin", "/lib", "/var", "/run"} == set()
    assert set(binds(words, "--ro-bind")) >= {"/usr", "/etc"}
    closed = [words[at + 1] for at, word in enumerate(words) if word == "--remount-ro"]
    assert set(closed) >= {"/", "/var", "/run"}


@pytest.mark.parametrize(
    ("line", "variables"),
    [
        ("run x -o /usr/local/src/results/one", {}),
        ("run '/usr/local/src/a scene.toml'", {}),
        ("check x --json '/usr/local/src/new folder/out.json'", {}),
        ("check x --json=/usr/local/src/out.json", {}),
        ("run /usr/local/etc/../src/scene.toml", {}),
        ("run ../src/scene.toml", {}),
        # the files of a rank's Slurm
        ("run x.toml", {"PMIX_RANK": "0", "PMIX_SERVER_TMPDIR": "/usr/local/src/pmix.1.0/"}),
    ],
)
def test_a_path_in_a_system_folder_is_bound_at_its_nearest_existing_parent(
    host: Host, line: str, variables: dict[str, str]
) -> None:
    if not Path("/usr/local/src").is_dir() or not Path("/usr/local/etc").is_dir():
        pytest.skip("this system has no /usr/local/src")
    words = host.plan(line, cwd=Path("/usr/local/etc"), **variables)
    assert binds(words)["/usr/local/src"] == "/usr/local/src"


def test_the_working_folder_keeps_its_name_even_with_spaces(host: Host, tmp_path: Path) -> None:
    (tmp_path / "two words").mkdir()
    words = host.plan("run scene.toml", cwd=tmp_path / "two words")
    assert follow(words, f"--chdir '{tmp_path}/two words'")


@pytest.mark.parametrize(
    ("answer", "extra"), [("HYDRA build details:", ""), ("(Open MPI) 5.0.7", "--oversubscribe ")]
)
def test_ranks_of_another_mpi_than_open_mpi_get_no_words_that_it_does_not_know(
    tmp_path: Path, answer: str, extra: str
) -> None:
    folder = clone(tmp_path / "clone")
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "python3").symlink_to(sys.executable)
    mpirun = tmp_path / "bin" / "mpirun"
    mpirun.write_text(f"#!/bin/sh\necho 'mpirun {answer}'\n")
    mpirun.chmod(0o755)
    own = {"HEADSTOCK_PYTHON": str(tmp_path / "bin" / "python3"), "HEADSTOCK_DRY_RUN": "1"}
    words = direct(folder, RAN, **own).stdout.splitlines()
    assert follow(words, f"{mpirun} {extra}--bind-to none -n 2")


@pytest.mark.parametrize("option", ["--with dolfinx-new", "--with=dolfinx-new"])
def test_with_a_newer_dolfinx_the_python_of_its_own_environment_computes(
    host: Host, option: str
) -> None:
    words = host.plan(f"{option} {RAN}")
    python = words[words.index("-m") - 2]
    assert re.search(r"/headstock/pip-dolfinx-new-\w{12}/bin/python3$", python)
    assert words[-4:] == RAN.split()
    assert str(Path(python).with_name("mpirun")) in words and "--oversubscribe" not in words


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("--with dolfinx-old run x.toml", "write --with dolfinx-new before a command"),
        *((f"exec{words}", "headstock: ") for words in ("", " --with", " --with nonsense true")),
    ],
)
def test_what_cannot_be_started_says_what_to_write(host: Host, line: str, said: str) -> None:
    done = host.launch(line)
    assert done.returncode == 1 and said in done.stderr
    assert host.builds() == 0


def test_slurm_runs_in_a_root_of_its_own_with_processes_and_a_host_name_of_its_own(
    host: Host,
) -> None:
    host.write("id", "echo 0")
    usual, words = (host.plan(f"test -m faults {more}") for more in ("", SLURM_TESTS))
    assert binds(usual, "--ro-bind")["/usr"] != binds(words, "--ro-bind")["/usr"]
    assert follow(words, "--proc /proc --tmpfs /run --hostname localhost")
    assert not follow(words, "--remount-ro /run")
    assert words[-3:] == ["-m", "faults", SLURM_TESTS]


def test_the_root_with_slurm_is_built_once_and_entered_so_that_it_ends_with_the_launcher(
    host: Host,
) -> None:
    programs = {"id": "echo 0", "stat": "exit 0", "unshare": "exit 0", "setpriv": BWRAP}
    for tool, text in programs.items():
        host.write(tool, text)
    found = [host.launch("test", SLURM_TESTS, OPENBLAS_CORETYPE="Haswell") for _ in range(2)]
    assert [done.returncode for done in found] == [0, 0], found[0].stderr
    assert host.builds() == 1
    assert ",slurm-wlm,munge " in host.log.read_text()
    words = found[1].stdout.splitlines()
    assert words[:4] == ["--pdeathsig", "KILL", "unshare", "--mount"]
    assert "--kill-child" in words
    assert words[-1] == SLURM_TESTS


@pytest.mark.parametrize(("ranks", "nodes"), [("8", "3"), ("2", "2")])
@pytest.mark.parametrize("line", ["run x.toml --ranks {}", "python --ranks {} mine.py"])
def test_ranks_in_an_allocation_of_several_nodes_are_launchers_started_by_srun(
    host: Host, ranks: str, nodes: str, line: str
) -> None:
    host.write("srun", "")
    words = host.plan(line.format(ranks), SLURM_JOB_NUM_NODES="3")
    assert words[:4] == ["srun", "--mpi=pmix", f"--nodes={nodes}", f"--ntasks={ranks}"]
    assert words[-5:] == [str(ROOT / "headstock"), *line.format(ranks).split()]
    assert "bwrap" not in words


@pytest.mark.parametrize(
    ("srun", "said"), [(None, "no srun on PATH"), ("echo none pmi2", "does not name pmix")]
)
def test_a_slurm_that_starts_no_mpi_over_nodes_is_named(
    host: Host, srun: str | None, said: str
) -> None:
    if srun:
        host.write("srun", srun)
    done = host.launch(RAN, SLURM_JOB_NUM_NODES="2")
    assert done.returncode == 1 and said in done.stderr


@pytest.mark.parametrize(
    ("variables", "transports"),
    [
        ({}, "self,sm"),
        ({"PMIX_RANK": "0", "SLURM_STEP_NUM_NODES": "1"}, "self,sm"),
        ({"PMIX_RANK": "0", "SLURM_STEP_NUM_NODES": "2"}, "self,sm,tcp"),
        ({"OMPI_COMM_WORLD_SIZE": "4", "OMPI_COMM_WORLD_LOCAL_SIZE": "4"}, "self,sm"),
        ({"OMPI_COMM_WORLD_SIZE": "4", "OMPI_COMM_WORLD_LOCAL_SIZE": "2"}, "self,sm,tcp"),
        ({"PMIX_RANK": "0", "SLURM_STEP_NUM_NODES": "2", "OMPI_MCA_btl": "self"}, "self"),
    ],
)
def test_transports_go_by_the_nodes_of_the_ranks(
    host: Host, variables: dict[str, str], transports: str
) -> None:
    own = {**host.environment(HEADSTOCK_PYTHON=str(host.bin / "python")), **variables}
    own.pop("HEADSTOCK_PRIVATE_ROOT")
    host.write("python", 'echo "$OMPI_MCA_btl"')
    done = run([ROOT / "headstock", "exec", host.bin / "python"], own)
    assert done.stdout.strip() == transports, done.stderr


# ---- building the root ----


def test_the_first_command_builds_the_root_and_the_second_uses_it(host: Host) -> None:
    first, second = host.enter(), host.enter()
    assert (first.returncode, second.returncode) == (0, 0), first.stderr
    assert "building the environment" in first.stderr
    assert second.stderr == ""
    assert host.builds() == len(host.kept()) == 1
    lines = (ROOT / "environment" / "packages.txt").read_text().splitlines()
    packages = [line for line in lines if line and not line.startswith("#")]
    assert f"--include={','.join(packages)} " in host.log.read_text()


def test_two_that_start_at_once_build_once(host: Host) -> None:
    host.mmdebstrap(seconds=0.7)
    started = [host.start() for _ in range(3)]
    errors = [process.communicate(timeout=60)[1] for process in started]
    assert [process.returncode for process in started] == [0, 0, 0], errors
    assert host.builds() == 1
    assert sum("waiting" in text for text in errors) == 2


@pytest.mark.parametrize(("number", "code"), [("TERM", 143), ("INT", 130), ("HUP", 143)])
def test_a_build_that_is_stopped_leaves_nothing_behind(host: Host, number: str, code: int) -> None:
    host.mmdebstrap(seconds=30)
    process = host.start()
    wait_for(lambda: host.builds() == 1)
    os.kill(process.pid, signal.Signals[f"SIG{number}"])
    _, errors = process.communicate(timeout=20)
    assert process.returncode == code
    assert "nothing was left behind" in errors
    assert host.kept() == []
    wait_for(lambda: not group_lives(int(host.pid.read_text())))


@pytest.mark.parametrize("ordinary", [False, True], ids=["root", "ordinary user"])
def test_a_killed_build_ends_and_what_it_left_is_cleared_by_the_next(
    host: Host, ordinary: bool
) -> None:
    if ordinary:
        host.ordinary_user()
    host.mmdebstrap(seconds=30)
    process = host.start()
    wait_for(lambda: host.builds() == 1)
    builder = int(host.pid.read_text())
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate(timeout=20)
    # nobody else stops it, and nobody waits for it
    wait_for(lambda: not group_lives(builder))
    assert host.growing() and all(host.growing())
    host.mmdebstrap()
    done = host.enter()
    assert done.returncode == 0, done.stderr
    assert host.growing() == [False]


def user_without(tool: str) -> Callable[[Host], None]:
    def hinder(host: Host) -> None:
        host.ordinary_user()
        host.lack(tool)

    return hinder


# what stands in the way of a root: what the host lacks, the words that are said, how often it is built
HINDRANCES: dict[str, tuple[Callable[[Host], object], str, int]] = {
    "failed build": (lambda host: host.mmdebstrap(code=25), "E: no such mirror", 1),
    "log of a failed build": (lambda host: host.mmdebstrap(code=25), "build.log", 1),
    "no room": (lambda host: host.write("df", DF.format(kb=1_000_000)), "XDG_CACHE_HOME", 0),
    "no tools": (
        user_without("mmdebstrap"),
        "sudo apt-get install mmdebstrap bubblewrap",
        0,
    ),
    "no uidmap": (
        user_without("newuidmap"),
        "missing: newuidmap. Install with: sudo apt-get install mmdebstrap bubblewrap debian-archive-keyring uidmap",
        0,
    ),
    "no subordinates": (
        lambda host: host.ordinary_user(subordinates=False),
        "sudo usermod --add-subuids 100000-165535 --add-subgids 100000-165535 somebody",
        0,
    ),
    "no namespaces": (
        lambda host: host.ordinary_user(namespaces=False),
        "sudo sysctl kernel.unprivileged_userns_clone=1",
        0,
    ),
}


@pytest.mark.parametrize("name", HINDRANCES)
def test_what_stands_in_the_way_of_a_root_is_said_with_its_remedy(host: Host, name: str) -> None:
    hinder, words, builds = HINDRANCES[name]
    hinder(host)
    done = host.enter()
    assert (done.returncode, done.stdout) == (1, "")
    assert words in done.stderr
    assert (host.builds(), host.kept()) == (builds, [])


def test_slurm_and_views_that_cannot_be_had_are_said_with_their_remedies(host: Host) -> None:
    host.ordinary_user()
    done = host.launch("test", SLURM_TESTS)
    assert done.returncode == 1 and "needs root: write sudo" in done.stderr
    assert host.builds() == 0
    host.write("bwrap", "echo 'bwrap: No permissions' >&2\nexit 1")
    done = host.enter()
    assert done.returncode == 1 and "--privileged" in done.stderr


def test_where_the_default_mirror_fails_the_one_of_the_hosts_apt_is_tried(host: Host) -> None:
    host.mmdebstrap(code=25)
    host.write("apt-get", "[ $1 = indextargets ] && echo http://mirror.example/debian")
    host.enter()
    mirror = "deb http://mirror.example/debian trixie main"
    tried = [line.strip().endswith(mirror) for line in host.log.read_text().splitlines()]
    assert tried == [False, True]


def test_an_ordinary_user_gets_the_root_through_a_tar_stream(host: Host) -> None:
    host.ordinary_user()
    done = host.enter()
    assert done.returncode == 0, done.stderr
    assert "--mode=unshare --format=tar" in host.log.read_text()
    assert host.growing() == [False]
    assert host.kept("*.pipe") == []


def test_root_installs_missing_tools_by_itself(host: Host) -> None:
    tool = (host.bin / "mmdebstrap").read_text()
    (host.bin / "mmdebstrap").unlink()
    host.write("id", "echo 0")
    host.write("stat", "")
    install = f'cat >"{host.bin}/mmdebstrap" <<"E"\n{tool}E\nchmod +x "{host.bin}/mmdebstrap"'
    host.write("apt-get", f'[ "$1" = install ] || exit 0\n{install}')
    done = host.enter()
    assert done.returncode == 0, done.stderr
    assert "installing mmdebstrap" in done.stderr
    assert host.builds() == 1


# ---- what is written where ----

# lays out the view that the launcher asks of bwrap, in namespaces of its own
VIEW = """#!{python} -P
import ctypes, os, sys
sys.path.insert(0, {packages!r})
from headstock.meshing.process import isolation

uid, gid, words, stage, folder = os.geteuid(), os.getegid(), sys.argv[1:], {stage!r}, "/"
os.unshare(os.CLONE_NEWUSER | os.CLONE_NEWNS)
for name, text in (("setgroups", "deny"), ("uid_map", f"{{uid}} {{uid}} 1"), ("gid_map", f"{{gid}} {{gid}} 1")):
    open(f"/proc/self/{{name}}", "w").write(text)
isolation._call("mount", None, b"/", None, isolation.MS_REC | isolation.MS_PRIVATE, None)
isolation._call("mount", b"tmpfs", stage.encode(), b"tmpfs", 0, None)

def close(target, flags):
    wanted = (ctypes.c_uint64 * 4)(isolation.MOUNT_ATTR_RDONLY, 0, 0, 0)
    isolation._syscall(isolation.SYS_MOUNT_SETATTR, isolation.AT_FDCWD, target.encode(), flags, wanted, ctypes.c_size_t(32))

while words[0].startswith("--"):
    option = words.pop(0)
    if option == "--die-with-parent":
        continue
    first = words.pop(0)
    if option in ("--bind", "--ro-bind", "--dev-bind"):
        target = stage + words.pop(0)
        if os.path.isdir(first):
            os.makedirs(target, exist_ok=True)
        elif not os.path.exists(target):
            os.makedirs(os.path.dirname(target), exist_ok=True)
            open(target, "w").close()
        isolation._call("mount", first.encode(), target.encode(), None, isolation.MS_BIND | isolation.MS_REC, None)
        if option == "--ro-bind":
            close(target, isolation.AT_RECURSIVE)
    elif option == "--symlink":
        os.symlink(first, stage + words.pop(0))
    elif option == "--tmpfs":
        os.makedirs(stage + first, exist_ok=True)
        isolation._call("mount", b"tmpfs", (stage + first).encode(), b"tmpfs", 0, None)
    elif option == "--remount-ro":
        close((stage + first).rstrip("/"), 0)
    else:
        assert option == "--chdir", option
        folder = first
os.chroot(stage)
os.chdir(folder)
os.execvp(words[0], words)
"""


@pytest.fixture
def entered(host: Host, tmp_path: Path) -> Host:
    """A host whose root has a shell, entered for real."""
    unshared = subprocess.run(
        [sys.executable, "-c", "import os; os.unshare(os.CLONE_NEWUSER | os.CLONE_NEWNS)"],
        capture_output=True,
    )
    if unshared.returncode:
        pytest.skip("no namespaces here")
    (tmp_path / "stage").mkdir()
    packages = str(ROOT / ".typing")
    stage = str(tmp_path / "stage")
    host.write("bwrap", VIEW.format(python=sys.executable, packages=packages, stage=stage))
    done = host.enter(HEADSTOCK_ENTER="bwrap")
    (root,) = host.kept()
    for program in ("sh", "mkdir"):
        path = shutil.which(program)
        assert path, done
        linked = run_process(["ldd", path], check=True).stdout
        for file in (path, *(word for word in linked.split() if word.startswith("/"))):
            target = root / "usr" / ("bin" if file == path else "lib")
            target.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, target)
    for name, place in (("bin", "usr/bin"), ("lib", "usr/lib"), ("lib64", "usr/lib")):
        (root / name).symlink_to(place)
    for stamp in host.kept("stamp-*"):
        stamp.unlink()
    return host


def write_inside(host: Host, path: str, cwd: Path) -> Done:
    """Write a file ``path`` from inside, the launcher having seen ``path`` as a word."""
    script = 'mkdir -p "${0%/*}" && echo inside >"$0"'
    own = {"HEADSTOCK_ENTER": "bwrap", "LD_LIBRARY_PATH": "/usr/lib"}
    return host.launch("exec sh -c", script, path, path, cwd=cwd, **own)


def test_what_is_written_inside_lies_on_the_host(entered: Host, tmp_path: Path) -> None:
    outside = tmp_path / "outside"
    (outside / "here").mkdir(parents=True)
    (outside / "link").symlink_to("here")
    host_files = {
        f"{outside}/results/new/x": outside / "results/new/x",
        "results/x": outside / "here/results/x",
        "../beside/x": outside / "beside/x",
        f"{outside}/link/x": outside / "here/x",
        f"{outside}/link/../x": outside / "x",
        "~/x": outside / "here/~/x",
        f"{outside}/two words/x": outside / "two words/x",
    }
    written = {}
    for path, host_file in host_files.items():
        done = write_inside(entered, path, outside / "here")
        written[path] = (done.returncode, done.stderr, host_file.read_text())
    assert written == dict.fromkeys(host_files, (0, "", "inside\n"))


def test_what_would_be_lost_is_refused(entered: Host, tmp_path: Path) -> None:
    (root,) = entered.kept()
    before = sorted(root.rglob("*"))
    folders = ("/newfolder", "/run", "/var", "/usr", "/etc", "/usr/lib", "/boot")
    refused = [write_inside(entered, f"{folder}/lost/x", tmp_path) for folder in folders]
    assert {done.returncode for done in refused} <= {1, 2}
    reasons = ("Read-only file system", "Directory nonexistent")
    assert [
        done.stderr for done in refused if not any(map(done.stderr.__contains__, reasons))
    ] == []
    assert sorted(root.rglob("*")) == before
    assert [folder for folder in folders if Path(folder, "lost").exists()] == []


def test_what_is_written_for_longer_than_a_boot_is_the_hosts(entered: Host, tmp_path: Path) -> None:
    folder = Path("/var/tmp", f"headstock-{os.getpid()}")
    done = write_inside(entered, f"{folder}/x", tmp_path)
    assert done.returncode == 0, done.stderr
    assert (folder / "x").read_text() == "inside\n"
    shutil.rmtree(folder)


def test_a_root_that_changed_after_it_was_built_is_not_entered(host: Host) -> None:
    assert [host.enter().returncode for _ in range(2)] == [0, 0]
    (root,) = host.kept()
    os.utime(root / "usr" / "bin", (1, 1))
    done = host.enter()
    assert (done.returncode, done.stdout) == (1, "")
    assert f"{root} is no longer what was built (usr/bin): remove that folder" in done.stderr


# ---- what is believed ----


@pytest.mark.parametrize(
    "place",
    ["", "headstock", "headstock/entrance", "headstock/root-planted", "headstock/blas-planted"],
)
def test_nothing_that_others_may_write_is_used(host: Host, place: str) -> None:
    target = host.cache / place
    if Path(place).suffix or "root" in place:
        target.mkdir(parents=True)
    elif place.count("/"):
        target.parent.mkdir(parents=True)
        target.write_text("planted")
    else:
        target.mkdir(parents=True)
    target.chmod(0o777)
    done = host.enter()
    assert (done.returncode, done.stdout) == (1, "")
    nothing = f"nothing in {host.cache}/headstock is used"
    assert f"{target} can be written by everybody: {nothing}" in done.stderr
    assert "XDG_CACHE_HOME=/path" in done.stderr
    assert host.builds() == 0


def test_a_link_in_a_folder_that_others_may_write_is_not_followed(
    host: Host, tmp_path: Path
) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "open").mkdir()
    (tmp_path / "open" / "cache").symlink_to(tmp_path / "mine")
    # the second is as the shared temporary folder, which keeps what is ours
    for mode, code in ((0o777, 1), (0o1777, 0)):
        (tmp_path / "open").chmod(mode)
        done = host.enter(XDG_CACHE_HOME=str(tmp_path / "open" / "cache"))
        assert done.returncode == code, done.stderr
        assert (f"{tmp_path}/open can be written by everybody" in done.stderr) == bool(code)


def test_what_others_own_is_named_and_groups_of_one_member_are_not(host: Host) -> None:
    lines = "1000 700 a /kept\n1001 700 a /alien\n1000 775 a /own\n1000 770 b /group\n0 755 root /root\n1000 1777 a /sticky\n"
    way = "0 0 0 //\n0 1777 root /tmp\n1001 755 a /theirs\n0 777 root /open\n"
    script = f". {str(ROOT / 'environment/cache_folder.sh')!r}\nunmapped() {{ return 1; }}\nme=1000\nforeign_paths"
    host.write("id", "echo a")
    done = run_process(["/bin/sh", "-c", script], env=host.environment(), input=lines + way)
    assert done.stdout.splitlines() == [
        "/alien belongs to the account with number 1001",
        "/group can be written by the group b",
        "/sticky can be written by everybody",
        "/theirs belongs to the account with number 1001",
        "/open can be written by everybody",
    ]


def homeless(host: Host, **more: str) -> Done:
    own = host.environment()
    environment = {name: own[name] for name in own.keys() - {"HOME", "XDG_CACHE_HOME"}}
    return run([ROOT / "headstock", "exec", "true"], environment | more)


def test_without_home_the_folder_of_the_account_is_taken_and_never_a_shared_one(
    host: Host, tmp_path: Path
) -> None:
    home = tmp_path / "home of the account"
    account = f'echo "a:x:1:1:A:{home}:/bin/sh"'
    host.write("getent", f'[ "$1 $2" = "passwd {os.geteuid()}" ] && {account}')
    for done in (homeless(host), homeless(host, HOME="")):
        assert done.returncode == 0, done.stderr
    (root,) = (home / ".cache" / "headstock").glob("root-*")
    assert "." not in root.name


def test_an_account_without_a_home_is_told_to_name_a_folder(host: Host) -> None:
    for tool in ("getent", "grep"):
        host.write(tool, "exit 2")
    done = homeless(host)
    assert (done.returncode, done.stdout) == (1, "")
    assert "XDG_CACHE_HOME=/path" in done.stderr
    assert homeless(host, XDG_CACHE_HOME=str(host.cache)).returncode == 0


# ---- choosing a Python ----


def sourced(script: str, environment: Mapping[str, str]) -> Done:
    setting = f'set -eu; project={str(ROOT)!r} cache="$XDG_CACHE_HOME/headstock" dry_run= me={os.geteuid()}\nsay() {{ echo "$*" >&2; }}\n'
    parts = "".join(
        f". {str(ROOT / 'environment' / name)!r}\n"
        for name in ("find_python.sh", "build_root.sh", "pip_group.sh", "settings.sh")
    )
    return run(["/bin/sh", "-c", setting + parts + script], environment)


@pytest.mark.parametrize(
    ("release", "has_packages"),
    [
        ("ID=debian\nVERSION_ID=13", True),
        ('ID=debian\nVERSION_ID="14.1"', True),
        ("ID=debian\nVERSION_ID=12", False),
        ("ID=debian\nNAME=testing", False),
        ("ID=ubuntu\nVERSION_ID=24.04", False),
        ("ID=arch", False),
    ],
)
def test_a_debian_that_has_the_packages_gets_the_apt_line_and_others_a_private_root(
    host: Host, tmp_path: Path, release: str, has_packages: bool
) -> None:
    (tmp_path / "os-release").write_text(release + "\n")
    done = sourced(f"suggest_apt {str(tmp_path / 'os-release')!r}; echo on", host.environment())
    assert (done.returncode, done.stdout) == ((1, "") if has_packages else (0, "on\n"))
    line = "sudo apt-get install --no-install-recommends python3-dolfinx-real "
    assert line in done.stderr if has_packages else done.stderr == ""


def test_a_python_that_fits_is_probed_once_and_again_after_it_changed(
    host: Host, tmp_path: Path
) -> None:
    (tmp_path / "dolfinx").mkdir()
    host.write("python3", f'echo probed >>"{tmp_path}/probes"\necho "{tmp_path}/dolfinx"')
    found = sourced('probe_pythons; known_python; echo "$python"', host.environment())
    assert found.stdout == f"{host.bin}/python3\n"
    assert sourced("known_python", host.environment()).returncode == 0
    os.utime(host.bin / "python3", (1, 1))
    assert sourced("known_python", host.environment()).returncode == 1
    assert (tmp_path / "probes").read_text() == "probed\n"


def test_the_python_that_runs_these_tests_passes_the_probe(host: Host) -> None:
    (host.bin / "python3").symlink_to(sys.executable)
    done = sourced("probe_pythons", host.environment())
    assert done.returncode == 0, done.stderr


# ---- pictures ----

# stands for the root's Python: pip makes the folder it is asked for, or finds no registry
PIP = """#!/bin/sh
case "$*" in *" pip install "*) ;; *) printf "%s\\n" "PYTHONPATH=$PYTHONPATH" "$@"; exit 0 ;; esac
echo "$@" >>{log}
[ {code} = 0 ] || {{ echo "no registry" >&2; exit {code}; }}
while [ "$1" != --target ]; do shift; done
mkdir -p "$2/anything"
"""


def pip_calls(host: Host, log: Path, code: int = 0) -> Done:
    host.write("bwrap", PIP.format(log=log, code=code))
    return host.enter(OPENBLAS_CORETYPE="Haswell")


def test_pyvista_and_pyuff_are_installed_once_and_found_by_every_command(
    host: Host, tmp_path: Path
) -> None:
    log = tmp_path / "pip.log"
    first, second = pip_calls(host, log), pip_calls(host, log)
    (pictures,) = host.kept("pip-pictures-????????????")
    (test_data,) = host.kept("pip-test_data-????????????")
    for done in (first, second):
        assert done.stdout.startswith(f"PYTHONPATH={ROOT}/.typing:{pictures}:{test_data}\n"), (
            done.stderr
        )
    for call, name in zip(log.read_text().splitlines(), ("pictures", "test_data"), strict=True):
        assert "--require-hashes" in call and f"-r {ROOT}/environment/{name}.txt" in call
        assert f"installing the packages of environment/{name}.txt" in first.stderr
    assert second.stderr == ""


def test_without_a_registry_the_program_goes_on_and_tries_again_later(
    host: Host, tmp_path: Path
) -> None:
    log = tmp_path / "pip.log"
    pip_calls(host, log)
    (group,) = host.kept("pip-pictures-????????????")
    shutil.rmtree(group)
    log.unlink()
    first, second = pip_calls(host, log, code=1), pip_calls(host, log, code=1)
    assert [done.returncode for done in (first, second)] == [0, 0]
    assert "no pictures of the machine" in first.stderr
    assert "no registry" not in first.stderr
    assert second.stderr == ""
    assert len(log.read_text().splitlines()) == 1
    os.utime(host.cache / "headstock" / "pip-pictures.failed", (1, 1))
    assert "pip-pictures" in pip_calls(host, log).stdout
    assert len(log.read_text().splitlines()) == 2


def test_a_system_python_with_a_vtk_that_draws_gets_no_second_one(
    host: Host, tmp_path: Path
) -> None:
    host.write("python3", 'case "$*" in *vtkEGLRenderWindow*) ;; *" pip "*) echo pip >&2 ;; esac')
    root, python = "root=", f"python={host.bin}/python3"
    script = f"{root} {python} inner_path=$PATH PYTHONPATH=; install_pictures; echo $PYTHONPATH"
    done = sourced(script, host.environment())
    (group,) = host.kept("pip-pictures-????????????")
    assert done.stdout == f":{group}\n", done.stderr
    assert list(group.iterdir()) == []
    assert "pip" not in done.stderr


def test_a_python_of_the_callers_choice_is_taken_as_it_is(host: Host) -> None:
    script = f"root= python=false inner_path= PYTHONPATH=; HEADSTOCK_PYTHON={sys.executable} install_pictures; echo $PYTHONPATH"
    assert sourced(script, host.environment()).stdout == "\n"
    assert host.kept("pip-pictures*") == []


# ---- running on a Python that is there ----


def direct(folder: Path, line: str, *words: str, cwd: str | Path = ROOT, **more: str) -> Done:
    passed = {key: value for key, value in os.environ.items() if key in {"PATH", "HOME"}}
    own = {"HEADSTOCK_PYTHON": sys.executable, "XDG_CACHE_HOME": str(folder / "cache")}
    return run([folder / "headstock", *shlex.split(line), *words], passed | own | more, cwd)


def clone(target: Path) -> Path:
    """What the launcher needs of a checkout."""
    target.mkdir(parents=True)
    shutil.copy(ROOT / "headstock", target)
    for folder in ("environment", ".typing", "api", "app", "geometry"):
        shutil.copytree(ROOT / folder, target / folder, symlinks=True)
    return target


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    return clone(tmp_path / "clone")


def test_each_of_two_clones_runs_its_own_code_from_anywhere(tmp_path: Path) -> None:
    folders = [clone(tmp_path / name) for name in ("one", "the other clone")]
    code = "import headstock.geometry; print(headstock.geometry.__path__[0])"
    runs = [direct(each, "exec", sys.executable, "-c", code, cwd=tmp_path) for each in folders]
    found = [Path(done.stdout.strip()).resolve() for done in runs]
    assert found == [folder / "geometry" for folder in folders], runs


def test_a_checkout_without_its_links_is_told_apart_from_a_fault(
    checkout: Path, tmp_path: Path
) -> None:
    (checkout / ".typing" / "headstock" / "app").unlink()
    (checkout / ".typing" / "headstock" / "app").write_text("../../app")
    done = direct(checkout, "doctor", cwd=tmp_path)
    assert done.returncode == 1
    assert "git config core.symlinks true" in done.stderr


def test_where_the_users_cache_cannot_be_written_a_folder_of_their_own_takes_its_place(
    checkout: Path,
    tmp_path: Path,
) -> None:
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    variables = {"XDG_CACHE_HOME": "/proc/self", "TMPDIR": str(temporary)}
    done = direct(checkout, "exec sh -c 'echo $XDG_CACHE_HOME'", cwd=tmp_path, **variables)
    spare = temporary / f"headstock-cache-{os.geteuid()}"
    assert done.stdout.strip() == str(spare), done.stderr
    assert "cannot be written" in done.stderr
    assert spare.stat().st_mode & 0o777 == 0o700
    shutil.rmtree(spare)
    spare.symlink_to(tmp_path)
    done = direct(checkout, "exec true", cwd=tmp_path, **variables)
    assert done.returncode == 1
    assert "name a folder with XDG_CACHE_HOME" in done.stderr


def test_a_link_to_the_launcher_runs_the_clone_it_points_to(checkout: Path, tmp_path: Path) -> None:
    (tmp_path / "linked").symlink_to(checkout / "headstock")
    own = {"PATH": os.environ["PATH"], "HEADSTOCK_PYTHON": sys.executable}
    done = run([tmp_path / "linked", "exec", "env"], own)
    assert f"PYTHONPATH={checkout}/.typing\n" in done.stdout


def test_modules_in_the_working_folder_are_not_picked_up(checkout: Path, tmp_path: Path) -> None:
    (tmp_path / "headstock.py").write_text("raise SystemExit('the wrong one')\n")
    (checkout / "app" / "command_line.py").write_text("print('the right one')\n")
    assert direct(checkout, "anything", cwd=tmp_path).stdout == "the right one\n"


def test_the_exit_code_is_the_programs(checkout: Path) -> None:
    (checkout / "app" / "command_line.py").write_text("raise SystemExit(2)\n")
    assert direct(checkout, "check x").returncode == 2


def test_with_ranks_each_gets_one_thread_and_a_failing_rank_ends_the_job(checkout: Path) -> None:
    (checkout / "app" / "command_line.py").write_text(
        "import os, sys\nfrom mpi4py import MPI\n"
        "comm = MPI.COMM_WORLD\n"
        "print(comm.size, os.environ['OMP_NUM_THREADS'], flush=True)\n"
        "comm.barrier()\n"
        "if comm.rank == 1:\n    sys.exit(3)\n"
        "comm.barrier()\n"
    )
    done = direct(checkout, "run --ranks 2")
    # Open MPI's mpirun itself writes a zero byte now and then
    assert done.stdout.replace("\0", "").split("\n")[:2] == ["2 1", "2 1"]
    assert done.returncode == 3


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, {"1", "2", "3", "4"}),
        ({"HEADSTOCK_THREADS": "5"}, {"5"}),
        ({"OMP_NUM_THREADS": "3"}, {"3"}),
    ],
)
def test_threads_are_free_cores_up_to_four_unless_the_caller_says(
    checkout: Path, given: dict[str, str], expected: set[str]
) -> None:
    shown = "exec sh -c 'echo $OMP_NUM_THREADS $OPENBLAS_NUM_THREADS'"
    openmp, blas = direct(checkout, shown, cwd=checkout, **given).stdout.split()
    assert openmp == blas
    assert openmp in expected


def test_a_clone_that_may_not_be_written_gets_its_bytecode_elsewhere(
    checkout: Path, tmp_path: Path
) -> None:
    checkout.chmod(0o555)
    try:
        done = direct(checkout, "exec env", XDG_CACHE_HOME=str(tmp_path / "cache"))
    finally:
        checkout.chmod(0o755)
    assert f"PYTHONPYCACHEPREFIX={tmp_path}/cache/headstock/bytecode" in done.stdout


def group_lives(leader: int) -> bool:
    """Whether a process of the group still runs; one that ended and waits to be collected does not
    count.
    """
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, group = status.read_text().rpartition(")")[2].split()[:3]
        except (FileNotFoundError, ProcessLookupError):
            continue
        if int(group) == leader and state != "Z":
            return True
    return False


def wait_for(condition: Callable[[], bool], seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)
