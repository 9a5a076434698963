"""Files -> RadiusCurves: MATLAB (BDT cells, IMR files), CSV and text tables, HDF5, Excel; and CSV back.

The content of a file decides, not its ending.
"""

from cavirheo.io.curves import write_csv
from cavirheo.io.shots import read_curves

__all__ = ["read_curves", "write_csv"]
