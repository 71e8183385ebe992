"""Other frameworks on the same work: CrypTen, SPU and PriX.

Each gets a virtual environment of its own, FOLDER/environments/NAME, filled by pip from its usual index.
A worker, `*_worker.py` beside this file, runs there, imports nothing of ciphernav_jax, and leaves the seconds
of each call and the outputs of one. A finished measurement is kept in FOLDER/results and used again on the
same machine with the same versions. A peer that cannot be installed or fails is said so; the others go on.

- `harness`: how a worker times its calls.
- `crypten_worker`, `spu_worker`, `prix_worker`: the works in each framework.
"""

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from ciphernav_jax import provenance
from ciphernav_jax.files import read_json, write_json
from experiments.measure import summary
from experiments.work import RATE, Work, error

HERE = Path(__file__).parent
REPEATS = 5


@dataclass(frozen=True)
class Environment:
    """A virtual environment: its name, and the arguments of each `pip install` that fills it."""

    name: str
    installs: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Peer:
    """A framework with one of its protocols.

    Attributes:
        title: as in the table.
        environment: what it runs in.
        worker: its script.
        parties: the numbers of parties that it can do.
        more: further arguments of the script.
    """

    title: str
    environment: Environment
    worker: Path
    parties: tuple[int, ...]
    more: tuple[str, ...] = field(default=())


CRYPTEN = Environment(
    "crypten",
    (
        ("torch==2.13.0",),
        ("--no-deps", "crypten==0.4.1"),  # it asks for packages that no longer exist
        ("numpy", "omegaconf", "onnx==1.16.2", "pyyaml", "scipy", "pandas", "tensorboard", "future"),
    ),
)
SPU = Environment("spu", (("spu==0.9.5",),))
PRIX = Environment("prix", (("prix-jax==0.2.0", "jax==0.10.2", "jaxlib==0.10.2"),))

PEERS = (
    Peer("CrypTen 0.4.1", CRYPTEN, HERE / "crypten_worker.py", (2, 3, 5)),
    Peer("SPU 0.9.5 SEMI2K", SPU, HERE / "spu_worker.py", (2, 3, 5), ("SEMI2K",)),
    Peer("SPU 0.9.5 ABY3", SPU, HERE / "spu_worker.py", (3,), ("ABY3",)),
    Peer("PriX 0.2.0", PRIX, HERE / "prix_worker.py", (2, 3, 5)),
)


def run_worker(
    peers: Sequence[Peer],
    works: Sequence[Work],
    parties: Sequence[int],
    folder: Path,
    repeat: int | None,
    time_limit: float,
    console: Console,
) -> list[dict[str, Any]]:
    """All works with all numbers of parties that each peer can do, one after the other.

    Returns:
        For each of them a dict of title, work, parties, and either seconds (`measure.summary`), error
        (`work.error`) and at (when it was measured), or status (what went wrong, in a few words) and
        detail (its last lines).
    """
    results = []
    for peer in peers:
        with console.status(f"{peer.title}: its environment"):
            problem = prepare(peer.environment, folder / "environments")
        for count in (count for count in parties if count in peer.parties):
            stopped = problem and {"status": "not installed", "detail": problem}
            for work in works:
                named = {"title": peer.title, "work": work.name, "parties": count}
                if not stopped:
                    with console.status(f"{peer.title}, {count} parties: {work.title}"):
                        found = _kept(peer, work, count, folder, repeat or REPEATS, time_limit)
                    if found.get("status") == "did not finish":  # and what follows takes longer
                        stopped = {"status": "not tried", "detail": f"{work.name} did not finish"}
                else:
                    found = stopped
                results.append(named | found)
                console.print(f"  {peer.title}, {count} parties, {work.name}: {_words(found)}")
    return results


def prepare(environment: Environment, folder: Path) -> str | None:
    """Make the environment unless it is complete; returns the last lines of what went wrong, or None."""
    home = folder / environment.name
    complete = home / "complete.json"
    installs = {"installs": [list(words) for words in environment.installs]}
    if complete.exists() and read_json(complete) == installs:
        return None
    pip = [str(home / "bin" / "python"), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    commands = [[sys.executable, "-m", "venv", "--clear", str(home)]]
    commands += [[*pip, *words] for words in environment.installs]
    for command in commands:
        done = subprocess.run(command, env=_environment(), capture_output=True, text=True, check=False)
        if done.returncode:
            return _last_lines(done.stderr or done.stdout)
    write_json(complete, installs)
    return None


def _kept(peer: Peer, work: Work, parties: int, folder: Path, repeats: int, limit: float) -> dict[str, Any]:
    """The result that is there for the same question on the same machine, or a new one."""
    question = {
        "installs": [list(words) for words in peer.environment.installs],
        "machine": provenance.machine(),
        "work": work.title,
        "repeats": repeats,
        "time_limit": limit,
    }
    name = f"{peer.title}-{parties}-{work.name}.json".lower().replace(" ", "-")
    path = folder / "results" / name
    if path.exists() and (kept := read_json(path))["question"] == question:
        return kept["result"]
    result = measure(peer, work, parties, folder / "environments", repeats, limit)
    if "seconds" in result or result["status"] == "did not finish":
        write_json(path, {"question": question, "result": result})
    return result


def measure(
    peer: Peer, work: Work, parties: int, environments: Path, repeats: int, limit: float
) -> dict[str, Any]:
    """Run the peer's worker, and compare what it computed with float64."""
    with tempfile.TemporaryDirectory() as temporary:
        inputs, outputs = Path(temporary) / "inputs.npz", Path(temporary) / "outputs.npz"
        np.savez(inputs, **arrays(work))
        python = environments / peer.environment.name / "bin" / "python"
        command = [python, peer.worker, inputs, outputs, parties, repeats, *peer.more]
        # In a session of its own, so that at the limit the parties it started end with it.
        process = subprocess.Popen(
            [str(word) for word in command],
            env=_environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        try:
            said = process.communicate(timeout=limit)[0]
        except BaseException as stopped:  # by the limit, or Ctrl-C
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            if not isinstance(stopped, subprocess.TimeoutExpired):
                raise
            return {"status": "did not finish", "detail": f"not in {limit:.0f} s"}
        if process.returncode or not outputs.exists():
            return {"status": "failed", "detail": _last_lines(said)}
        with np.load(outputs) as stored:
            seconds = stored["seconds"].tolist()
            found = [stored[f"output{i}"] for i in range(len(stored.files) - 1)]
        return {"seconds": summary(seconds), "error": error(found, work.expected()), "at": provenance.now()}


def arrays(work: Work) -> dict[str, Any]:
    """What a worker is given, as `harness.job` reads it."""
    given: dict[str, Any] = {"work": work.name, "rate": RATE}
    data = list(work.args)
    if isinstance(data[0], list):
        for i, (kernel, bias) in enumerate(data.pop(0)):
            given |= {f"kernel{i}": kernel.astype(np.float32), f"bias{i}": bias.astype(np.float32)}
    return given | {name: array.astype(np.float32) for name, array in zip("xy", data, strict=False)}


def _environment() -> dict[str, str]:
    # Not our Python's path nor our settings of JAX: a peer sees its own packages only, as installed.
    ours = ("PYTHONPATH", "PYTHONHOME", "JAX_ENABLE_X64", "JAX_COMPILATION_CACHE_DIR", "XLA_FLAGS")
    return {name: value for name, value in os.environ.items() if name not in ours}


def _last_lines(text: str) -> str:
    return "\n".join(text.strip().splitlines()[-4:])


def _words(result: dict[str, Any]) -> str:
    if "seconds" not in result:
        return f"{result['status']}. {result['detail']}"
    return f"{1e3 * result['seconds']['median']:.1f} ms, error {result['error']:.1e}"
