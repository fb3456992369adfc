from .hyperelastic import mooney_rivlin as mooney_rivlin
from .hyperelastic import neo_hookean as neo_hookean
from .hyperelastic import st_venant_kirchhoff as st_venant_kirchhoff
from .large_motions import LargeMotions as LargeMotions
from .large_motions import LargeSolution as LargeSolution
from .large_motions import LargeStep as LargeStep
from .large_motions import StepCut as StepCut
from .nonlinear_body import NonlinearBody as NonlinearBody
