"""Read RadiusCurves from MATLAB (BDT cells, IMR files), tables (text, workbooks), HDF5 and recordings; write CSV.

The content of a file decides its format; only recordings, and HDF5 files ending in .mat, are recognised by the ending.
"""

from cavirheo.io.curves import write_csv
from cavirheo.io.shots import measure, read_curves

__all__ = ["measure", "read_curves", "write_csv"]
