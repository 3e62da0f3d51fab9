"""Every page of the gallery runs as it stands and draws one figure."""

import runpy
import warnings
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import pytest

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("plot_*.py"))


@pytest.mark.filterwarnings("ignore:.*no sill within the samples:truepose.errors.VariogramWarning")
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
@pytest.mark.exhaustive
def test_runs(path: Path) -> None:
    with mpl.rc_context({"backend": "agg"}), warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        runpy.run_path(str(path), run_name="__main__")
        assert len(plt.get_fignums()) == 1
        plt.close("all")
