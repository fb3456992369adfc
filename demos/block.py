"""The block of demos/block.toml, through the Python API.

A steel block of 3 x 1 x 1 m is clamped on the left, pressed onto a rigid plane by 40 MPa on its top, pulled to the
right and pushed to the back.  Where does it lift, where does it stick, where does it slide?

    python demos/block.py
"""

from mpi4py import MPI

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Material, Traction

# The body: faces have names, loads are tractions in pascals.
problem = ContactProblem(
    mesh=coulomb.box((3.0, 1.0, 1.0), cells=(30, 10, 10)),
    material=Material(young=2.119e11, poisson=0.277),
    clamps=[Clamp("left")],
    tractions=[Traction("top", (0.0, 1.0e7, -4.0e7)), Traction("right", (2.0e7, 0.0, 0.0))],
    contact=Contact("bottom", friction=0.3),
)

# Successive Tresca problems, each by path following; raises NotConverged if the Coulomb residual stays above 1e-8.
solution = problem.solve(tolerance=1e-8)

# The solver says it has converged; the certificate says whether it is right.
total = problem.comm.allreduce(-problem.surface.vectors(solution.contact_force.reshape(-1, 3)).sum(axis=0), op=MPI.SUM)
if problem.comm.rank == 0:
    print(f"force of the foundation on the block: {total[0]:.6g}, {total[1]:.6g}, {total[2]:.6g} N")
    print(f"{solution.result.iterations} Tresca problems, contraction {solution.result.contraction:.2f} a step")
    print(solution.certificate)

# Displacement, stress, pressure, friction and slip for ParaView, a summary, and picture.png.
solution.write("results/block")
