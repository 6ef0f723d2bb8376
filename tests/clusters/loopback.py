"""A Slurm of one machine: munge, the controller and node daemons as children of the tests, on loopback, in one folder.

The daemons are Debian's (``apt-get install --no-install-recommends slurm-wlm munge``). Nothing of the system's own
configuration is read, nothing needs systemd or another user.
"""

from __future__ import annotations

import getpass
import os
import secrets
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "squeue", "scancel", "scontrol")
SEARCH = os.pathsep.join([os.environ.get("PATH", ""), "/usr/sbin", "/sbin"])
NODES = ("node1", "node2")

# Nodes claim more than the machine has (config_overrides): these jobs are small, whatever they ask for.
CONFIGURATION = """
ClusterName=loopback
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller_port}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket,cred_expire=10
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/%n.pid
SlurmdSpoolDir={folder}/spool.%n
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
SchedulerType=sched/builtin
SchedulerParameters=sched_interval=2,batch_sched_delay=0
SlurmdParameters=config_overrides
SlurmctldTimeout=10
SlurmdTimeout={node_timeout}
KillWait=20
MinJobAge=10
InactiveLimit=0
ReturnToService=2
{nodes}
PartitionName=cpu Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


def missing() -> list[str]:
    """The programs that are not installed."""
    return [name for name in PROGRAMS if shutil.which(name, path=SEARCH) is None]


def free_ports(count: int) -> list[int]:
    """Ports nobody listens on, found together so that they differ."""
    sockets = [socket.socket() for _ in range(count)]
    for one in sockets:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports


def until(condition: Callable[[], object], seconds: float, what: str) -> None:
    """Waits for a condition; ``AssertionError`` names what did not come."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"{what}: not within {seconds:.0f} s"
        time.sleep(0.1)


class Loopback:
    """The daemons, by name: ``munged``, ``slurmctld`` and the nodes."""

    def __init__(self, folder: Path, node_timeout: int = 8) -> None:
        self.folder = folder
        self.daemons: dict[str, subprocess.Popen] = {}
        (folder / "state").mkdir(parents=True)
        key = folder / "munge.key"
        key.write_bytes(secrets.token_bytes(1024))
        key.chmod(0o400)
        controller, *ports = free_ports(1 + len(NODES))
        host = socket.gethostname().split(".")[0]
        nodes = "\n".join(
            f"NodeName={name} NodeHostname={host} NodeAddr=127.0.0.1 Port={port} CPUs=64 RealMemory=300000"
            for name, port in zip(NODES, ports, strict=True)
        )
        self.configuration = folder / "slurm.conf"
        self.configuration.write_text(
            CONFIGURATION.format(
                host=host, controller_port=controller, user=getpass.getuser(), folder=folder,
                node_timeout=node_timeout, nodes=nodes,
            )
        )  # fmt: skip

    @property
    def environment(self) -> dict[str, str]:
        return os.environ | {"SLURM_CONF": str(self.configuration), "PATH": SEARCH}

    def start(self) -> None:
        self._run(
            "munged", "--foreground", "--force", f"--socket={self.folder}/munge.socket",
            f"--key-file={self.folder}/munge.key", f"--pid-file={self.folder}/munged.pid",
            f"--log-file={self.folder}/munged.log", f"--seed-file={self.folder}/munge.seed", "--num-threads=2",
        )  # fmt: skip
        until((self.folder / "munge.socket").exists, 10, "munge")
        self.start_controller()
        for name in NODES:
            self.start_node(name)
        until(lambda: self.states() == dict.fromkeys(NODES, "idle"), 30, "idle nodes")

    def start_controller(self) -> None:
        self._run("slurmctld", "-D")
        until(lambda: self.ask("scontrol", "ping").returncode == 0, 20, "the controller")

    def start_node(self, name: str) -> None:
        (self.folder / f"spool.{name}").mkdir(exist_ok=True)
        self._run("slurmd", "-D", "-N", name, named=name)

    def kill(self, name: str) -> None:
        """SIGKILL to one daemon. What it had started lives on, as after a lost connection."""
        daemon = self.daemons.pop(name)
        daemon.kill()
        daemon.wait()

    def stop(self) -> None:
        self.ask("scancel", "--user", getpass.getuser())
        for daemon in reversed(self.daemons.values()):
            daemon.send_signal(signal.SIGTERM)
        for daemon in self.daemons.values():
            try:
                daemon.wait(10)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()

    def ask(self, *command: str) -> subprocess.CompletedProcess:
        return subprocess.run(
            command, env=self.environment, capture_output=True, text=True, check=False, timeout=60
        )

    def states(self) -> dict[str, str]:
        """State of each node, as sinfo says it."""
        lines = self.ask("sinfo", "--noheader", "--Node", "--format=%N %t").stdout.split("\n")
        return dict(line.split() for line in lines if line)

    def jobs(self) -> list[tuple[str, str, str]]:
        """(id, name, state) of all jobs the controller still knows."""
        said = self.ask("squeue", "--noheader", "--states=all", "--format=%i|%j|%T").stdout
        return [tuple(line.split("|")) for line in said.splitlines()]

    def living(self) -> list[str]:
        """Ids of jobs that wait, run or are being ended."""
        return [job for job, _, state in self.jobs() if state in ("PENDING", "RUNNING", "COMPLETING")]

    def node(self, job: str) -> str:
        """Where a job runs."""
        said = self.ask("squeue", "--noheader", f"--jobs={job}", "--states=RUNNING", "--format=%N").stdout
        return said.strip()

    def _run(self, program: str, *arguments: str, named: str | None = None) -> None:
        name = named or program
        with (self.folder / f"{name}.out").open("ab") as output:
            self.daemons[name] = subprocess.Popen(
                [shutil.which(program, path=SEARCH) or program, *arguments], env=self.environment,
                stdout=output, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, start_new_session=True,
            )  # fmt: skip
