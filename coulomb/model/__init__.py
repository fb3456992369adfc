"""Where finite elements and solvers meet: contact, problem, solution, certificate, load steps and histories."""
