"""Prints the oldest versions that pyproject.toml allows of the dependencies, as constraints for pip.

python tests/lowest.py [extra ...]
"""

import re
import sys
import tomllib
from pathlib import Path

project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
extras = [wanted for name in sys.argv[1:] for wanted in project["optional-dependencies"][name]]
for wanted in project["dependencies"] + extras:
    print(re.sub(r">=([^,]+).*", r"==\1", wanted))
