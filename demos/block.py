"""The block of demos/block.toml, through the Python API, solved by two methods.

A steel block of 3 x 1 x 1 m is clamped on the left, pressed onto a rigid plane by 40 MPa on its top, pulled to the
right and pushed to the back.

    python demos/block.py
"""

import numpy as np
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
rank_0 = problem.comm.rank == 0

# The first method, the default: the interior-point method on the whole problem with friction.  It raises NotConverged
# if the residual of Coulomb's problem stays above the tolerance.
solution = problem.solve(tolerance=1e-8)
loop = solution.result

# The second method, successive Tresca: Tresca problems, each with the slip bounds g <- F x_n of the one before.  The
# contraction is the measured factor by which each problem reduces the error of the slip bounds.
tresca = problem.solve(solver=coulomb.SuccessiveTresca(tolerance=1e-8)).result

total = problem.comm.allreduce(-problem.surface.vectors(solution.contact_force.reshape(-1, 3)).sum(axis=0), op=MPI.SUM)
apart = problem.comm.allreduce(np.sum((tresca.x - loop.x) ** 2), op=MPI.SUM)
size = problem.comm.allreduce(np.sum(loop.x**2), op=MPI.SUM)
if rank_0:
    print(f"force of the foundation on the block: {total[0]:.6g}, {total[1]:.6g}, {total[2]:.6g} N")
    print("                interior point  successive Tresca")
    print(f"Tresca problems             -  {tresca.outer_steps:17d}")
    print(f"contraction                 -  {tresca.contraction:17.2g}")
    print(f"path-following steps {loop.newton_steps:8d}  {tresca.newton_steps:17d}")
    print(f"products by A        {loop.products:8d}  {tresca.products:17d}")
    print(f"Coulomb residual     {loop.residual:8.1e}  {tresca.residual:17.1e}")
    print(f"the two answers differ by {np.sqrt(apart / size):.0e} of the forces")
    print("problem  residual  contraction")
    for step in tresca.history:
        print(f"{step.iteration:7d}  {step.residual:8.1e}  {step.contraction:11.2g}")
    # Independent of the solver: the answer checked against the problem.
    print(solution.certificate)

# Displacement, stress, pressure, friction and slip for ParaView, a summary, and picture.png.
solution.write("results/block")
