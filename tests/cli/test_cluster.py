"""The same verbs on a dask cluster: the same bytes and answers, nothing lost, no worker that would answer otherwise."""

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
from functools import partial
from pathlib import Path

import pytest
from answers import same
from conftest import EXAMPLE, ROOT, contents, refusal, refused, until
from dask import config
from distributed import Client, LocalCluster

from cavirheo import InputError, read_curves
from cavirheo.inference.analysis import Analysis
from cavirheo.parallel import Executor, on_processes, on_threads, run_jobs, run_on_any_core
from cavirheo.workflow import Store, _run, analyse_all, check_workers, identity, on_workers, slurm_cluster


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    how = {"processes": False, "n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    quiet = config.set({"distributed.worker.profile.enabled": False})  # it can stop Python (workflow.py)
    with quiet, LocalCluster(**how) as cluster, Client(cluster) as one:
        yield one


@pytest.fixture
def workers(client) -> Executor:
    return partial(on_workers, client)


def double(job: int) -> int:
    if job < 0:
        raise InputError(f"no {job}", "test.refused")
    return 2 * job


def test_every_job_comes_back_once_with_its_index_and_an_error_is_raised_here(client, workers):
    for executor in (on_threads, partial(on_threads, workers=1), partial(on_processes, workers=2), workers):
        assert sorted(executor(double, range(7, 50))) == [(i, 2 * (i + 7)) for i in range(43)]
        assert list(executor(double, [])) == []
        with refused("test.refused", "no -1"), closing(executor(double, [-1, -1])) as flow:
            list(flow)
    assert run_jobs(lambda job: run_on_any_core(double, job), range(7, 50), 4) == [2 * job for job in range(7, 50)]
    other = on_processes(time.sleep, [0, 1, 1], 3)
    assert next(other)[0] == 0
    with closing(on_processes(time.sleep, [0, 1e6, 1e6], 2)) as flow:
        assert next(flow)[0] == 0  # the others end with the flow
    assert sorted(other) == [(1, None), (2, None)]  # and those of another caller do not
    with refused("parallel.ended"):
        list(on_processes(os._exit, [1, 1], 2))
    with pytest.raises(InputError):  # of a worker that comes later and is another
        client.submit(_run, "cavirheo 9.9", double, 1).result()


def test_processes_end_when_their_parent_is_killed():
    flow = "on_processes(time.sleep, [0, 300, 300], 2)"
    program = f"import time; from cavirheo.parallel import on_processes; [print(one, flush=True) for one in {flow}]"
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE) as parent:
        parent.stdout.readline()  # the first job is done
        parent.kill()
        parent.communicate(timeout=60)  # to the end of its output, which the processes hold open, too


def test_answers_of_a_cluster_are_those_of_this_machine(workers, tmp_path):
    curves, analysis = read_curves(EXAMPLE), Analysis(model="bdt-viscoelastic", seed=4)
    here = analyse_all(curves, {"": analysis}, Store(tmp_path / "here"), visible=False)[""]
    there = analyse_all(curves, {"": analysis}, Store(tmp_path / "there"), workers, visible=False)[""]
    assert list(here) == list(there) == list(range(len(curves)))
    for k, mine in here.items():
        assert same(replace(mine, seconds=0.0), replace(there[k], seconds=0.0))
    names = [sorted(path.name for path in (tmp_path / way).iterdir()) for way in ("here", "there")]
    assert len({*names[0]} & {*names[1]}) == len(curves)  # so that each goes on where the other stopped


def begin(module: str, *words: object, cwd: Path, path: object = ROOT / "src", **more: str) -> subprocess.Popen[bytes]:
    """A module of Python in a process of its own, whose output goes to said.log."""
    about = os.environ | {"PYTHONPATH": str(path), "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False"} | more
    command = [sys.executable, "-m", module, *map(str, words)]
    with (cwd / "said.log").open("ab") as log:
        return subprocess.Popen(command, cwd=cwd, env=about, stdout=log, stderr=log)


@contextmanager
def cluster(folder: Path, *paths: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """(address, workers) of a scheduler and a worker for each place of the package, in processes of their own."""
    local, where = ("--host", "127.0.0.1", "--no-dashboard"), folder / "where.json"
    processes = [begin("distributed.cli.dask_scheduler", "--port", 0, "--scheduler-file", where, *local, cwd=folder)]
    try:
        until(lambda: where.exists() and where.read_text().endswith("\n}"), 60.0)  # whole
        address = json.loads(where.read_text())["address"]
        for path in paths:
            words = (address, "--nthreads", 1, "--no-nanny", *local)
            processes.append(begin("distributed.cli.dask_worker", *words, cwd=folder, path=path))
        yield address, processes[1:]
    finally:
        for process in reversed(processes):
            process.kill()
            process.wait()


def test_another_version_and_a_worker_without_the_package_are_refused_by_name(run, tmp_path):
    other, without = tmp_path / "other", tmp_path / "without"
    shutil.copytree(ROOT / "src" / "cavirheo", other / "cavirheo")
    (other / "cavirheo-9.9.dist-info").mkdir()
    (other / "cavirheo-9.9.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: cavirheo\nVersion: 9.9\n")
    (without / "cavirheo").mkdir(parents=True)
    (without / "cavirheo" / "__init__.py").touch()
    with cluster(tmp_path, other, without) as (address, _), Client(address) as client:
        client.wait_for_workers(2, timeout=60)
        names = list(client.nthreads())
        words = ("generate", ROOT / "recipes" / "laptop.toml", "-n", 4, "-o", "d", "--scheduler", address)
        refusal(run(*words), "9.9", *names)
    assert not Path("d").exists()


def test_a_worker_with_other_code_is_refused(client, monkeypatch):
    other = f"{identity().partition(', code')[0]}, code 00000000"
    answers = dict(zip(client.nthreads(), (identity(), other), strict=True))
    monkeypatch.setattr(client, "run", lambda *_, **__: answers)
    with refused("cluster.refused", "code 00000000"):
        check_workers(client, lambda _: None, 5.0)


QUEUE = {"queue": "short", "cores": 4, "memory": "8 GB", "walltime": "00:30:00"}


def slurm(**settings: object) -> config.set:
    return config.set({f"jobqueue.slurm.{name}": value for name, value in (QUEUE | settings).items()})


def test_a_job_is_what_the_settings_of_dask_jobqueue_say(tmp_path):
    pytest.importorskip("dask_jobqueue")
    more = {"job-script-prologue": ["module load python"], "job-extra-directives": ["--constraint=icelake"]}
    more["shared-temp-directory"] = str(tmp_path)
    with slurm(**more), slurm_cluster() as made:
        script = made.job_script()
    lines = "#SBATCH -p short\n#SBATCH -t 00:30:00\n#SBATCH --constraint=icelake\nmodule load python\n"
    ours = "export DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED=False\n"
    assert {*(lines + ours).splitlines()} <= {*script.splitlines()}
    assert [word for word in ("--nworkers 4", "--nthreads 1") if word not in script] == []


@pytest.mark.slow
def test_a_slurm_of_one_node_makes_the_same_data_set(tmp_path):
    """Killed three times in between; the scheduler's connections are encrypted."""
    if os.geteuid() or not all(map(shutil.which, ("munged", "slurmctld", "slurmd", "sbatch"))):
        pytest.skip("needs root and the Debian packages slurmctld, slurmd, slurm-client, munge")
    script, node = ROOT / "tests" / "slurm_node.sh", tmp_path / "node"
    prologue = [f"export PYTHONPATH={ROOT / 'src'}"]
    settings = QUEUE | {"cores": 1, "shared-temp-directory": str(tmp_path), "job-script-prologue": prologue}
    (tmp_path / "jobqueue.yaml").write_text(json.dumps({"jobqueue": {"slurm": settings}}))  # JSON is YAML
    words = ("generate", ROOT / "recipes" / "laptop.toml", "-n", 2000, "--quiet", "-o")
    assert begin("cavirheo", *words, "here", cwd=tmp_path).wait() == 0
    subprocess.run([script, "start", node], check=True, timeout=60)
    words += ("there", "--slurm", 2)
    try:
        for count in (1, 2, 3, None):
            places = {"SLURM_CONF": str(node / "slurm.conf"), "DASK_CONFIG": str(tmp_path)}
            process = begin("cavirheo", *words, cwd=tmp_path, **places)
            if count:
                until(lambda count=count: len(contents(tmp_path / "there")) >= count, 300.0)
                process.kill()
            assert process.wait() == (-signal.SIGKILL if count else 0), (tmp_path / "said.log").read_text()
    finally:
        subprocess.run([script, "stop", node], check=True)
    assert len(contents(tmp_path / "here")) > 3  # files: each kill was between two of them
    assert contents(tmp_path / "there") == contents(tmp_path / "here")


@pytest.mark.slow
def test_nothing_is_lost_when_a_worker_is_killed(tmp_path):
    words = ("infer", EXAMPLE, "--material", "nhkv", "--no-pictures", "--quiet", "-o")
    assert begin("cavirheo", *words, "here", cwd=tmp_path).wait() == 0
    with cluster(tmp_path, ROOT / "src", ROOT / "src") as (address, workers):
        process = begin("cavirheo", *words, "there", "--scheduler", address, cwd=tmp_path)
        until(lambda: any((tmp_path / "there").glob("unfinished/*.npz")), 300.0)
        workers[0].kill()
        assert process.wait() == 0, (tmp_path / "said.log").read_text()
    here, there = (json.loads((tmp_path / way / "result.json").read_text())["curves"] for way in ("here", "there"))
    for row in (*here, *there):
        del row["seconds"]
    assert here == there
