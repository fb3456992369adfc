"""K^-1, the compliance A = B K^-1 B^T, what is learnt of A, Krylov methods: PETSc and LAPACK, no friction law."""
