"""Print the addresses at which `make ui` shows the runs of the project's MLflow database."""

from pathlib import Path

from shaftpose.core.errors import exit_on_input_error
from shaftpose.tracking.connection import select_store, workspace
from shaftpose.tracking.views import view_links

if __name__ == "__main__":
    with exit_on_input_error():
        select_store(None, workspace(Path.cwd()))
        print("\n".join(view_links()))
