"""The same verbs on a dask cluster: the same bytes and answers, nothing lost, no worker that would answer otherwise."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from dask import config

pytest.importorskip("distributed", reason="needs the extra [cluster]")

from distributed import Client, LocalCluster

from cavirheo import InputError
from cavirheo.inference.analysis import Analysis
from cavirheo.io import read_curves
from cavirheo.parallel import Threads
from cavirheo.prior import Prior
from cavirheo.problem import TrainingProblem
from cavirheo.training import dataset, shards
from cavirheo.training.dataset import generate
from cavirheo.workflow.analyse import Unfinished
from cavirheo.workflow.cluster import check, connected
from cavirheo.workflow.cluster.check import Identity, admitted, code_of, identity, reports
from cavirheo.workflow.cluster.executor import Workers, _batch
from cavirheo.workflow.cluster.slurm import read_settings

EXAMPLE = ROOT / "examples" / "soft_gel.csv"
PROBLEM = TrainingProblem("newtonian", Prior.uniform({"log10_viscosity": [-4.0, 0.0], "stretch": [3.0, 11.0]}))


@pytest.fixture(scope="module")
def workers() -> Iterator[Workers]:
    """Of two workers in this process."""
    how = {"processes": False, "n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    quiet = config.set({"distributed.worker.profile.enabled": False})  # it can stop Python (cluster/slurm.py)
    with quiet, LocalCluster(**how) as cluster, Client(cluster) as client:
        yield Workers(client, identity())


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.glob("*.h5"))}


# --- the executor -----------------------------------------------------------------------------------------------------


def double(job: int) -> int:
    return 2 * job


def refuse(job: int) -> int:
    raise InputError(f"no {job}", "test.refused")


def test_every_job_comes_back_once_with_its_index(workers):
    for executor in (Threads(2), Threads(1), workers):
        assert sorted(executor.flow(double, range(7, 50))) == [(i, 2 * (i + 7)) for i in range(43)]
        assert list(executor.flow(double, [])) == []


def test_an_error_of_the_work_is_raised_here(workers):
    for executor in (Threads(2), workers):
        with pytest.raises(InputError, match="no 1") as caught, closing(executor.flow(refuse, [1, 1])) as flow:
            list(flow)
        assert caught.value.code == "test.refused"
    assert len(list(workers.flow(double, range(3)))) == 3


# --- the same bytes and answers ---------------------------------------------------------------------------------------


def test_a_data_set_is_the_same_from_threads_and_a_cluster_and_after_it_was_stopped(workers, monkeypatch, tmp_path):
    monkeypatch.setattr(dataset, "SHARD", 6)
    monkeypatch.setattr(dataset, "CHUNK", 2)
    generate(PROBLEM, 14, tmp_path / "threads", seed=3, workers=2, progress=False)
    generate(PROBLEM, 14, tmp_path / "dask", seed=3, executor=workers, progress=False)
    assert len(files(tmp_path / "threads")) == 3
    assert files(tmp_path / "dask") == files(tmp_path / "threads")

    write = shards.write_hdf5

    def stopped(path, *content):
        write(path, *content)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(shards, "write_hdf5", stopped)
        with pytest.raises(KeyboardInterrupt):
            generate(PROBLEM, 14, tmp_path / "cut", seed=3, executor=workers, progress=False)
    assert len(files(tmp_path / "cut")) == 1
    made = generate(PROBLEM, 14, tmp_path / "cut", seed=3, executor=workers, progress=False)
    assert (made.written, made.skipped) == (2, 1)
    assert files(tmp_path / "cut") == files(tmp_path / "threads")


def test_answers_of_a_cluster_are_those_of_this_machine(workers, tmp_path):
    curves = read_curves(EXAMPLE)
    analysis = Analysis(verify="none", seed=4)
    here = Unfinished(tmp_path / "here", shown=False).answers(curves, analysis)
    there = Unfinished(tmp_path / "there", shown=False, executor=workers).answers(curves, analysis)
    assert here.indices == there.indices == list(range(len(curves)))
    for mine, theirs in zip(here, there, strict=True):
        np.testing.assert_array_equal(mine.theta, theirs.theta)
        assert mine.best == theirs.best
        assert (mine.checks.verdict, mine.checks.message) == (theirs.checks.verdict, theirs.checks.message)
    names = [sorted(path.name for path in (tmp_path / way / "unfinished").iterdir()) for way in ("here", "there")]
    assert names[0] == names[1]  # so that each goes on where the other stopped
    assert len(names[0]) == len(curves)


# --- who may work -----------------------------------------------------------------------------------------------------


def test_code_is_compared_wherever_the_package_lies(tmp_path):
    """Also below a folder named app, as in containers."""
    (tmp_path / "app" / "cavirheo").mkdir(parents=True)
    module = tmp_path / "app" / "cavirheo" / "solver.py"
    found = []
    for text in ("1", "2"):
        module.write_text(text)
        found.append(code_of(tmp_path / "app" / "cavirheo"))
    assert found[0] != found[1]


def dask(*words: str, path: object = ROOT / "src", cwd: Path) -> subprocess.Popen[bytes]:
    about = os.environ | {"PYTHONPATH": str(path), "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False"}
    said = (cwd / "dask.log").open("ab")
    return subprocess.Popen(
        [sys.executable, "-m", f"distributed.cli.dask_{words[0]}", *words[1:], "--host", "127.0.0.1", "--no-dashboard"],
        cwd=cwd, env=about, stdout=said, stderr=said,
    )  # fmt: skip


@contextmanager
def cluster(folder: Path, count: int) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """(address, workers) of a scheduler and workers in processes of their own."""
    scheduler = dask("scheduler", "--port", "0", "--scheduler-file", str(folder / "where.json"), cwd=folder)
    made: list[subprocess.Popen[bytes]] = []
    try:
        while not (folder / "where.json").exists():
            time.sleep(0.05)
            assert scheduler.poll() is None, (folder / "dask.log").read_text()
        address = json.loads((folder / "where.json").read_text())["address"]
        made += [worker(address, folder) for _ in range(count)]
        yield address, made
    finally:
        for process in (*made, scheduler):
            process.kill()
            process.wait()


def worker(address: str, folder: Path, path: object = ROOT / "src") -> subprocess.Popen[bytes]:
    return dask("worker", address, "--nthreads", "1", "--no-nanny", path=path, cwd=folder)


def test_another_version_and_a_worker_without_the_package_are_refused_by_name(run, tmp_path):
    other, without = tmp_path / "other", tmp_path / "without"
    shutil.copytree(ROOT / "src" / "cavirheo", other / "cavirheo")
    (other / "cavirheo-9.9.dist-info").mkdir()
    (other / "cavirheo-9.9.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: cavirheo\nVersion: 9.9\n")
    (without / "cavirheo").mkdir(parents=True)
    (without / "cavirheo" / "__init__.py").touch()
    with cluster(tmp_path, 0) as (address, _):
        two = [worker(address, tmp_path, path) for path in (other, without)]
        try:
            with Client(address) as client:
                client.wait_for_workers(2, timeout=60)
                found = {one.wrong for one in reports(client)}
                names = list(client.nthreads())
            status, out, err = run(
                "generate", ROOT / "recipes" / "laptop.toml", "-n", 4, "-o", "d", "--scheduler", address
            )
            checked = run("cluster", "check", "--scheduler", address)
        finally:
            for process in two:
                process.kill()
                process.wait()
    assert {text[:30] for text in found} == {"it has cavirheo 9.9, and this ", "cannot import what is needed: "}
    assert (status, out) == (2, "")
    assert "error: refused" in err
    assert all(name in err for name in names)
    assert not Path("d").exists()
    assert checked[0] == 1
    assert all(f"refused: {name}" in checked[2] for name in names)


@pytest.mark.parametrize(
    ("part", "said"), [("bits", "differ in their last bits"), ("code", "other code"), ("version", "it has cavirheo")]
)
def test_a_worker_that_would_answer_otherwise_is_refused(workers, monkeypatch, part, said):
    mine = check.about()
    wrong = iter([{}, {part: "0" * 64}])

    def told(function, on_error):
        return {a: mine | {"identity": replace(mine["identity"], **next(wrong))} for a in workers.client.nthreads()}

    monkeypatch.setattr(workers.client, "run", told)
    with pytest.raises(InputError, match=said) as caught:
        admitted(workers.client, lambda _: None, 5.0)
    assert caught.value.code == "cluster.refused"


def test_a_worker_that_comes_later_must_be_the_same(workers):
    wanted = Identity("9.9", "", "")
    with pytest.raises(InputError, match="stop it, and the same command goes on"):
        list(Workers(workers.client, wanted).flow(double, [1]))
    assert _batch(identity(), double, [1, 2])[1] == [2, 4]


def test_without_the_extra_the_option_says_what_to_install(run, monkeypatch):
    for name in ("distributed", "dask", "dask_jobqueue"):
        monkeypatch.setitem(sys.modules, name, None)
    recipe = ROOT / "recipes" / "laptop.toml"
    status, _, err = run("generate", recipe, "-n", 2, "-o", "d", "--scheduler", "tcp://127.0.0.1:1")
    assert status == 2
    assert "pip install 'cavirheo[cluster]'" in err
    assert run("generate", recipe, "-n", 2, "-o", "d", "--quiet")[0] == 0
    with connected(None, print) as executor:
        assert executor is None


@pytest.mark.parametrize("scheduler", ["127.0.0.1:80", "http://a:1", "tcp://a", "local", "", "slurm:", "slurm:no.toml"])
def test_what_is_no_scheduler_is_refused(scheduler, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError), connected(scheduler, print):
        raise AssertionError("it connects")


# --- SLURM ------------------------------------------------------------------------------------------------------------

QUEUE = 'queue = "short"\ncores = 4\nmemory = "8 GB"\nwalltime = "00:30:00"\n'


def test_the_job_of_a_file_is_what_it_says(tmp_path):
    jobqueue = pytest.importorskip("dask_jobqueue")
    path = tmp_path / "slurm.toml"
    path.write_text(f'{QUEUE}environment = ["module load python"]\noptions = ["--constraint=icelake"]\ntls = false\n')
    from cavirheo.workflow.cluster import slurm

    with slurm.jobs_of(read_settings(path)) as made:
        assert isinstance(made, jobqueue.SLURMCluster)
        script = made.job_script()
    for line in (
        "#SBATCH -p short",
        "#SBATCH -t 00:30:00",
        "#SBATCH --constraint=icelake",
        "module load python",
        "export DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED=False",
    ):
        assert line in script.splitlines()
    assert "--nworkers 4" in script
    assert "--nthreads 1" in script


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f"{QUEUE}jbos = 2", "did you mean jobs"), (QUEUE.replace("4", "0"), "cores"),
        (QUEUE.replace("8 GB", "8"), "memory"), ("queue = ", "no TOML"),
    ],
)  # fmt: skip
def test_a_mistake_in_the_file_is_named(tmp_path, text, said):
    (tmp_path / "slurm.toml").write_text(text)
    with pytest.raises(InputError, match=said) as caught:
        read_settings(tmp_path / "slurm.toml")
    assert caught.value.code == "cluster.settings"


@pytest.mark.slow
def test_a_slurm_of_one_node_makes_the_same_data_set(tmp_path):
    """Killed three times in between; the scheduler's connections are encrypted."""
    programs = ("munged", "slurmctld", "slurmd", "sbatch")
    if os.geteuid() or not all(map(shutil.which, programs)):
        pytest.skip("needs root and the Debian packages slurmctld, slurmd, slurm-client, munge")
    script, node = ROOT / "tests" / "slurm_node.sh", tmp_path / "node"
    settings = {
        "queue": "short",
        "jobs": 2,
        "cores": 1,
        "memory": "2 GB",
        "walltime": "00:10:00",
        "folder": str(tmp_path),
    }
    settings["environment"] = [f"export PYTHONPATH={ROOT / 'src'}"]
    (tmp_path / "slurm.toml").write_text("".join(f"{key} = {json.dumps(value)}\n" for key, value in settings.items()))
    words = ("generate", ROOT / "recipes" / "laptop.toml", "-n", 2000, "--quiet", "-o")
    assert command(*words, "here", cwd=tmp_path).wait() == 0
    subprocess.run([script, "start", node], check=True, timeout=60)
    try:
        about = {"SLURM_CONF": str(node / "slurm.conf")}
        for count in range(1, 4):
            process = command(*words, "there", "--scheduler", "slurm:slurm.toml", cwd=tmp_path, more=about)
            wait_for(lambda count=count: len(files(tmp_path / "there")) >= count, process)
            process.kill()
            assert process.wait() == -signal.SIGKILL, (tmp_path / "said.log").read_text()
        process = command(*words, "there", "--scheduler", "slurm:slurm.toml", cwd=tmp_path, more=about)
        assert process.wait() == 0, (tmp_path / "said.log").read_text()
    finally:
        subprocess.run([script, "stop", node], check=True)
    assert len(files(tmp_path / "there")) == 4
    assert files(tmp_path / "there") == files(tmp_path / "here")


# --- killed -----------------------------------------------------------------------------------------------------------


def command(*words: object, cwd: Path, more: dict[str, str] | None = None) -> subprocess.Popen[bytes]:
    about = os.environ | {"PYTHONPATH": str(ROOT / "src")} | (more or {})
    said = (cwd / "said.log").open("ab")
    return subprocess.Popen(
        [sys.executable, "-m", "cavirheo", *map(str, words)], cwd=cwd, env=about, stdout=said, stderr=said
    )


def wait_for(there, process: subprocess.Popen[bytes]) -> None:
    while not there() and process.poll() is None:
        time.sleep(0.05)


@pytest.mark.slow
def test_nothing_is_lost_when_a_worker_is_killed(tmp_path):
    words = ("infer", EXAMPLE, "--no-pictures", "--quiet", "-o")
    assert command(*words, "here", cwd=tmp_path).wait() == 0
    with cluster(tmp_path, 2) as (address, workers):
        process = command(*words, "there", "--scheduler", address, cwd=tmp_path)
        wait_for(lambda: any((tmp_path / "there").glob("unfinished/*.npz")), process)
        assert process.poll() is None, (tmp_path / "said.log").read_text()
        workers[0].kill()
        assert process.wait() == 0, (tmp_path / "said.log").read_text()
    ways = [json.loads((tmp_path / way / "result.json").read_text())["curves"] for way in ("here", "there")]
    for here, there in zip(*ways, strict=True):
        assert {k: v for k, v in here.items() if k != "seconds"} == {k: v for k, v in there.items() if k != "seconds"}
