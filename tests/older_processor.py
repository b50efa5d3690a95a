"""Run a command as on an older processor: BLAS, NumPy, numba and the C library take the kernels of
one without AVX2 and FMA.

``python -m tests.older_processor COMMAND ...``. Results that depend on the processor differ then,
on one machine.
"""

import os
import sys

import numpy as np


def environment() -> dict[str, str]:
    """Return the variables that choose the older kernels (on x86-64)."""
    umath = np._core._multiarray_umath
    found = [name for name in umath.__cpu_dispatch__ if umath.__cpu_features__.get(name)]
    return {
        "OPENBLAS_CORETYPE": "Nehalem",
        "NPY_DISABLE_CPU_FEATURES": " ".join(found),
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX2_Usable,-FMA_Usable",
        "NUMBA_CPU_NAME": "x86-64",
        "NUMBA_CPU_FEATURES": "",
        "TESTS_ON_OLDER_PROCESSOR": "1",  # which says to tests/thoroughness.py what to leave out
    }


if __name__ == "__main__":
    os.execvpe(sys.argv[1], sys.argv[1:], {**os.environ, **environment()})
