/* Matrices in blocks on several ranks (block_matrix.py, which has structures of the same layout), and the blocks of vectors
that go between ranks with a product.  Which MPI there is, is not known here: its functions and its
requests, which are persistent, come from mpi4py. */

#ifndef EXCHANGE_H
#define EXCHANGE_H

struct exchange {
    int (*start)(int, void *);        /* MPI_Startall */
    int (*wait)(int, void *, void *); /* MPI_Waitall */
    void *fetch, *give, *statuses;    /* as many requests for either direction as there are messages */
    double *values, *buffer;          /* blocks of other ranks; `count` blocks for other ranks, or from these */
    const int *own;                   /* which blocks of this rank the latter are */
    int messages, count, size;        /* numbers in a block */
};

/* The rows that have entries in columns of other ranks, as places in `values`; of `columns` blocks. */
struct others {
    const struct exchange *ghosts;
    const int *rows, *ptr, *col;
    const float *val, *low;
    double *sums;
    int n, columns;
};

/* Rows of this rank: the entries in its own columns, an upper triangle if the matrix is symmetric, and the others, 0 on
one rank. */
struct blocks {
    const int *shares, *ptr, *col;
    const float *val, *low;
    double *sums;
    const struct others *others;
    int n, columns, threads;
};

/* Begin to fetch blocks of x; like the next ones 0, or MPI's error. */
static inline int begin_fetching(const struct others *matrix, const double *x)
{
    if (!matrix)
        return 0;
    const struct exchange *ghosts = matrix->ghosts;
    const int size = ghosts->size;
    double *out = ghosts->buffer;
    for (int i = 0; i < ghosts->count; i++)
        for (int c = 0; c < size; c++)
            *out++ = x[(long)size * ghosts->own[i] + c];
    return ghosts->start(ghosts->messages, ghosts->fetch);
}

static inline int end_fetching(const struct exchange *ghosts)
{
    return ghosts->wait(ghosts->messages, ghosts->fetch, ghosts->statuses);
}

/* Begin to send `values` to the ranks of these blocks. */
static inline int begin_giving(const struct exchange *ghosts) { return ghosts->start(ghosts->messages, ghosts->give); }

/* b <- b + what other ranks have given. */
static inline int end_giving(const struct exchange *ghosts, double *b)
{
    const int error = ghosts->wait(ghosts->messages, ghosts->give, ghosts->statuses), size = ghosts->size;
    const double *given = ghosts->buffer;
    for (int i = 0; i < ghosts->count; i++)
        for (int c = 0; c < size; c++)
            b[(long)size * ghosts->own[i] + c] += *given++;
    return error;
}

#endif
