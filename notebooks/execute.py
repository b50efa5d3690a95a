"""Run the notebooks in place, so that what they show is what their code does now.

    python -m notebooks.execute                       all of them, at the full setting (minutes)
    python -m notebooks.execute 02_polytope           one of them
    python -m notebooks.execute --setting small       seconds, to see that they run; not to be committed

A notebook reads its setting from the environment variable NOTEBOOK_SETTING. It is written back only if every cell
ran without an error, and as the same bytes where nothing has changed on the same day: no times, no names of machines or
kernels. Its stamp (``benchmarks.stamps``) is in its metadata. The picture of the cell that is tagged "picture" is also
attached to the first cell, which shows it below question and answer.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import matplotlib.font_manager  # makes its list of fonts here, or the first notebook would report that
import nbformat
from jupyter_client.kernelspec import KernelSpec, KernelSpecManager
from jupyter_client.manager import AsyncKernelManager
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError
from nbformat import NotebookNode

from benchmarks import stamps

HERE = Path(__file__).resolve().parent
SETTINGS = ("small", "full")
PICTURE = "picture"  # the tag of the cell whose picture opens the notebook
_ATTACHED = f"{PICTURE}.png"  # the name by which the first cell shows it
_TIMEOUT = 600  # seconds a cell
_COMPILING = re.compile(r"(elicit: (compiling, once on this machine: .*|compiled, in \d+ s)\n)+")
_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


class _ThisPython(KernelSpecManager):  # type: ignore[misc, unused-ignore]  # traitlets are untyped in some versions
    """Whatever kernel a notebook names, the running interpreter: nothing has to be installed for it."""

    def get_kernel_spec(self, kernel_name: str) -> KernelSpec:
        """A kernel of ``sys.executable``."""
        command = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
        return KernelSpec(argv=command, display_name="Python 3", language="python")


def execute(notebook: NotebookNode, setting: str, folder: Path) -> NotebookNode:
    """Run all cells of a notebook, in place, in a kernel of its own whose working directory is ``folder``.

    Raises CellExecutionError at the first cell that fails, and ValueError for a setting that there is not.
    """
    if setting not in SETTINGS:
        raise ValueError(f"the setting must be one of {', '.join(SETTINGS)}, not {setting!r}")
    with tempfile.TemporaryDirectory() as scratch:
        manager = AsyncKernelManager(kernel_name="python3", kernel_spec_manager=_ThisPython())
        manager.connection_file = str(Path(scratch) / "kernel.json")
        manager.transport = "ipc" if os.name == "posix" else "tcp"
        client = NotebookClient(
            notebook,
            km=manager,
            timeout=_TIMEOUT,
            record_timing=False,
            coalesce_streams=True,  # or the pieces of the output would depend on time
            resources={"metadata": {"path": str(folder)}},
        )
        client.execute(env=_environment(setting, Path(scratch)), cleanup_kc=True)
    return clean(with_picture(notebook), setting)


def with_picture(notebook: NotebookNode) -> NotebookNode:
    """Attach the picture of the tagged cell, if there is one, to the first cell."""
    for cell in notebook.cells:
        if PICTURE in cell.metadata.get("tags", ()):
            drawn = [output.data["image/png"] for output in cell.outputs if "image/png" in output.get("data", {})]
            notebook.cells[0].attachments = {_ATTACHED: {"image/png": drawn[0]}}
    return notebook


def clean(notebook: NotebookNode, setting: str) -> NotebookNode:
    """Put fixed metadata in place of what depends on time and machine, and the setting and ``code_hash`` beside it. Of
    the outputs only the word that something is compiled here for the first time depends on the machine: it goes."""
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    executed = {"setting": setting, "code": code_hash(notebook)}
    metadata = {"kernelspec": kernel, "language_info": {"name": "python"}, "executed": executed}
    notebook.metadata = nbformat.from_dict(metadata)  # type: ignore[no-untyped-call, unused-ignore]
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
        if cell.cell_type == "code":
            cell.outputs = [output for output in cell.outputs if not _COMPILING.fullmatch(output.get("text", ""))]
    return notebook


def code_hash(notebook: NotebookNode) -> str:
    """A hash of the code of all cells: it tells whether the outputs are those of this code."""
    digest = hashlib.blake2b(digest_size=16)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            digest.update(cell.source.encode() + b"\0")
    return digest.hexdigest()


def read(path: Path) -> NotebookNode:
    """The notebook in a file. Raises FileNotFoundError."""
    notebook: NotebookNode = nbformat.read(path, as_version=4)  # type: ignore[no-untyped-call, unused-ignore]
    return notebook


def write(notebook: NotebookNode, path: Path) -> None:
    """Put the notebook into a file, as a whole or not at all."""
    nbformat.validate(notebook)
    part = path.with_suffix(".part")
    nbformat.write(notebook, part)  # type: ignore[no-untyped-call, unused-ignore]
    part.replace(path)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; returns 1 if a notebook failed, which then stays as it was."""
    parser = argparse.ArgumentParser(description="Run the notebooks in place.")
    parser.add_argument("names", nargs="*", help="notebooks to run, such as 02_polytope; all by default")
    parser.add_argument("--setting", choices=SETTINGS, default="full", help="the size of everything (default: full)")
    chosen = parser.parse_args(arguments)
    failed = 0
    for path in _paths(parser, chosen.names):
        start = time.perf_counter()
        command = f"python -m notebooks.execute {path.stem}{'' if chosen.setting == 'full' else ' --setting small'}"
        stamp = stamps.made_now(command, "in its cells", str(path))
        try:
            ran = execute(read(path), chosen.setting, HERE)
            ran.metadata.executed.stamp = str(stamp)
            write(ran, path)
        except CellExecutionError as error:
            failed = 1
            print(f"{path.name} failed and was left as it was:\n{error}", file=sys.stderr)
        else:
            print(f"{path.name}: {time.perf_counter() - start:.0f} s")
    return failed


def _paths(parser: argparse.ArgumentParser, names: Sequence[str]) -> list[Path]:
    paths = [HERE / f"{Path(name).stem}.ipynb" for name in names] or sorted(HERE.glob("*.ipynb"))
    for path in paths:
        if not path.exists():
            parser.error(f"there is no notebook {path.name} beside {Path(__file__).name}")
    return paths


def _environment(setting: str, scratch: Path) -> dict[str, str]:
    """The kernel's environment: nothing of the user's own profile, figures inside the notebook, one thread."""
    kept = {name: value for name, value in os.environ.items() if name not in ("PYTHONWARNINGS", "MPLBACKEND")}
    return kept | {
        "NOTEBOOK_SETTING": setting,
        "IPYTHONDIR": str(scratch / "ipython"),
        "MPLBACKEND": "module://matplotlib_inline.backend_inline",
        "MATPLOTLIBRC": str(Path(matplotlib.get_data_path()) / "matplotlibrc"),
        "PYTHONHASHSEED": "0",
        **dict.fromkeys(_ONE_THREAD, "1"),
    }


if __name__ == "__main__":
    sys.exit(main())
