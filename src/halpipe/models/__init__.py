"""The task model and the schedule: frozen values, no input or output, no arrays.

Traces are in `halpipe.models.trace`, which few commands need.
"""

from halpipe.models.coercion import DurationLike as DurationLike
from halpipe.models.schedule import ChainLatency as ChainLatency
from halpipe.models.schedule import CostTerms as CostTerms
from halpipe.models.schedule import Job as Job
from halpipe.models.schedule import ModeSchedule as ModeSchedule
from halpipe.models.schedule import Part as Part
from halpipe.models.schedule import Reaction as Reaction
from halpipe.models.schedule import ResourceLoad as ResourceLoad
from halpipe.models.schedule import Schedule as Schedule
from halpipe.models.schedule import Status as Status
from halpipe.models.schedule import TransitionTable as TransitionTable
from halpipe.models.schedule import UnitLoad as UnitLoad
from halpipe.models.system import WHOLE as WHOLE
from halpipe.models.system import Access as Access
from halpipe.models.system import Chain as Chain
from halpipe.models.system import HealthRule as HealthRule
from halpipe.models.system import Interrupt as Interrupt
from halpipe.models.system import Mode as Mode
from halpipe.models.system import Origin as Origin
from halpipe.models.system import Precedence as Precedence
from halpipe.models.system import Resource as Resource
from halpipe.models.system import Run as Run
from halpipe.models.system import Source as Source
from halpipe.models.system import Split as Split
from halpipe.models.system import Task as Task
from halpipe.models.system import TaskModel as TaskModel
from halpipe.models.system import Transfer as Transfer
from halpipe.models.system import Transition as Transition
from halpipe.models.system import Unit as Unit
from halpipe.models.system import Version as Version
from halpipe.models.words import AccessKind as AccessKind
from halpipe.models.words import Anchor as Anchor
from halpipe.models.words import Binding as Binding
from halpipe.models.words import Edge as Edge
from halpipe.models.words import HealthAction as HealthAction
from halpipe.models.words import HealthEvent as HealthEvent
from halpipe.models.words import Match as Match
from halpipe.models.words import ResourceKind as ResourceKind
