"""Builds sdist and wheel into dist/, and runs the fast tests from the wheel, with nothing of the repository beside.

python tests/wheel.py [3.11 3.12 ...]    each interpreter that is found, by default the one that runs this

Of each Python: an empty environment, the wheel, what it needs and pytest, no extra; the tests and examples of the
sdist in a folder of their own. Exit status 1 if a test fails or no interpreter is found.
"""

import os
import shutil
import subprocess
import sys
import tarfile
import venv
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[1]
QUIET = ("--quiet", "--disable-pip-version-check")


def interpreter(version: str) -> str | None:
    """The program of this Python ("3.12"), of pyenv or on the path; None where there is none."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"), "versions")
    return next(map(str, sorted(pyenv.glob(f"{version}.*/bin/python"))), shutil.which(f"python{version}"))


def build(folder: Path) -> tuple[Path, Path]:
    """(sdist, wheel) in dist/; the wheel is built from the sdist, so that the sdist is known to be complete."""
    venv.create(folder, with_pip=True)
    python = folder / "bin" / "python"
    subprocess.run([python, "-m", "pip", "install", *QUIET, "build"], check=True)
    shutil.rmtree(ROOT / "dist", ignore_errors=True)
    subprocess.run([python, "-m", "build", "--outdir", ROOT / "dist", ROOT], check=True, stdout=subprocess.DEVNULL)
    (sdist,), (wheel,) = (ROOT / "dist").glob("*.tar.gz"), (ROOT / "dist").glob("*.whl")
    return sdist, wheel


def tested(program: str, sdist: Path, wheel: Path, folder: Path) -> bool:
    """Whether the fast tests pass from this wheel with this Python."""
    subprocess.run([program, "-m", "venv", folder / "env"], check=True)
    python, constraints = folder / "env" / "bin" / "python", ROOT / "constraints.txt"
    surroundings = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    install = [python, "-m", "pip", "install", *QUIET, "-c", constraints, wheel, "pytest"]
    subprocess.run(install, env=surroundings, check=True)
    with tarfile.open(sdist) as archive:
        archive.extractall(folder, filter="data")
    (away,) = folder.glob("cavirheo-*")
    shutil.rmtree(away / "src")
    words = ["-m", "pytest", "-m", "not slow and not hostile", "-p", "no:cacheprovider", "--tb=short"]
    return subprocess.run([python, *words], cwd=away, env=surroundings, check=False).returncode == 0


def main(versions: list[str]) -> int:
    programs = {version: interpreter(version) for version in versions} or {"this Python": sys.executable}
    said = dict.fromkeys(programs, "no interpreter here")
    with TemporaryDirectory() as folder:
        sdist, wheel = build(Path(folder, "build"))
        for version, program in programs.items():
            if program:
                fine = tested(program, sdist, wheel, Path(folder, version.replace(" ", "-")))
                said[version] = "passes" if fine else "FAILS"
    print(*(f"{wheel.name} with {version}: {word}" for version, word in said.items()), sep="\n")
    return 0 if "passes" in said.values() and "FAILS" not in said.values() else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
