import subprocess
import sys

import pytest

ONNX_ONLY = "import shaftpose.export.onnx_export"
ALL_OF_NETWORK = "import shaftpose.training.module, shaftpose.network.checkpoint"


@pytest.mark.parametrize(
    ("statement", "forbidden"),
    [(ALL_OF_NETWORK, ("bpy", "dvc", "mlflow")), (ONNX_ONLY, ("lightning", "bpy", "mlflow"))],
)
def test_imports_stay_narrow(statement: str, forbidden: tuple[str, ...]) -> None:
    check = f"import sys; {statement}; print([n for n in {forbidden} if n in sys.modules])"
    done = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
