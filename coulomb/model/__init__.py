"""Contact problems, which combine finite elements and solvers: contact, solution, certificate, load histories."""
