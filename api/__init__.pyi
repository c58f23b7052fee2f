from headstock.geometry.errors import HeadstockError as HeadstockError
from headstock.machine import Machine as Machine
from headstock.nouns import Axis as Axis
from headstock.nouns import Box as Box
from headstock.nouns import Column as Column
from headstock.nouns import Component as Component
from headstock.nouns import Interface as Interface
from headstock.nouns import Joint as Joint
from headstock.nouns import Load as Load
from headstock.nouns import Material as Material
from headstock.nouns import Plate as Plate
from headstock.nouns import Point as Point
from headstock.nouns import Support as Support
from headstock.nouns import Tube as Tube
from headstock.pipeline.results.files import read_mesh as read_mesh
from headstock.pipeline.results.results import Results as Results
from headstock.runs import check as check
from headstock.runs import compare as compare
from headstock.runs import identify as identify
from headstock.runs import load as load
from headstock.runs import open as open
from headstock.runs import plan as plan
from headstock.runs import run as run
from headstock.runs import study as study
from headstock.runs import sweep as sweep
from headstock.scene.reading.findings import SceneError as SceneError
from headstock.studies.comparison import Comparison as Comparison
from headstock.studies.identification.identification import Identification as Identification
from headstock.studies.parameters.tables import StudyTable as StudyTable
from headstock.studies.sweeps.results import SweepResults as SweepResults

__version__: str
__all__: list[str]
