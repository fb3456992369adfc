"""K^-1, the compliance A = B K^-1 B^T and its low-rank approximation, Krylov methods: PETSc and LAPACK, no friction
law."""
