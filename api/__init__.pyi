from headstock.geometry.errors import HeadstockError as HeadstockError
from headstock.machine import Machine as Machine
from headstock.pipeline.results.results import Results as Results
from headstock.runs import check as check
from headstock.runs import load as load
from headstock.runs import open as open
from headstock.runs import plan as plan
from headstock.runs import run as run
from headstock.scene.reading.findings import SceneError as SceneError

__version__: str
__all__: list[str]
