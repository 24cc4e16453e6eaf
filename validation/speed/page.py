"""The documentation's page of a run, and its chart."""
from pathlib import Path
def write(run: dict, docs: Path) -> None:
    raise NotImplementedError
