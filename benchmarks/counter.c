/* Counts what a program asks of MPI, by MPI's profiling interface: preloaded, it stands before the library.

   MPI_Pcontrol(1) begins the next phase, MPI_Pcontrol(0) phase 0; at the end every rank writes a line per phase to $COULOMB_MPI_COUNTS.RANK:
   phase, messages sent between two ranks, their bytes, reductions, other collective calls, largest number of bytes
   that one collective call takes from a rank. */
#include <mpi.h>
#include <stdio.h>
#include <stdlib.h>

#define PHASES 8
#define SLOTS 65536

static long long messages[PHASES], sent[PHASES], reductions[PHASES], others[PHASES], largest[PHASES];
static int phase = 0;
static struct { MPI_Request request; long long bytes; int used; } slots[SLOTS];

static unsigned place(MPI_Request r) {
    unsigned long long key = 0;
    unsigned char *p = (unsigned char *)&r;
    for (unsigned i = 0; i < sizeof r; i++) key = key * 1099511628211ull + p[i];
    return (unsigned)(key >> 7) % SLOTS;
}
static long long size_of(long long count, MPI_Datatype type) {
    int size = 0;
    if (type != MPI_DATATYPE_NULL) PMPI_Type_size(type, &size);
    return count * size;
}
static void message(long long bytes) { messages[phase]++; sent[phase] += bytes; }
static void remember(MPI_Request r, long long bytes) {
    unsigned at = place(r);
    for (unsigned k = 0; k < SLOTS; k++, at = (at + 1) % SLOTS)
        if (!slots[at].used || slots[at].request == r) {
            slots[at].used = 1; slots[at].request = r; slots[at].bytes = bytes; return;
        }
}
static void started(MPI_Request r) {
    unsigned at = place(r);
    for (unsigned k = 0; k < SLOTS && slots[at].used; k++, at = (at + 1) % SLOTS)
        if (slots[at].request == r) { if (slots[at].bytes >= 0) message(slots[at].bytes); return; }
}
static void collective(long long *kind, long long bytes) {
    kind[phase]++;
    if (bytes > largest[phase]) largest[phase] = bytes;
}

int MPI_Pcontrol(const int level, ...) {
    static int last = 0;
    phase = level == 1 && last < PHASES - 1 ? ++last : 0;
    return MPI_SUCCESS;
}

#define SEND(name) \
int name(const void *b, int n, MPI_Datatype t, int d, int tag, MPI_Comm c) { \
    if (d != MPI_PROC_NULL) message(size_of(n, t)); return P##name(b, n, t, d, tag, c); }
SEND(MPI_Send) SEND(MPI_Ssend) SEND(MPI_Rsend) SEND(MPI_Bsend)
#define ISEND(name) \
int name(const void *b, int n, MPI_Datatype t, int d, int tag, MPI_Comm c, MPI_Request *r) { \
    if (d != MPI_PROC_NULL) message(size_of(n, t)); return P##name(b, n, t, d, tag, c, r); }
ISEND(MPI_Isend) ISEND(MPI_Issend) ISEND(MPI_Irsend)
int MPI_Sendrecv(const void *b, int n, MPI_Datatype t, int d, int tag, void *rb, int rn, MPI_Datatype rt, int s, int rtag,
                 MPI_Comm c, MPI_Status *st) {
    if (d != MPI_PROC_NULL) message(size_of(n, t));
    return PMPI_Sendrecv(b, n, t, d, tag, rb, rn, rt, s, rtag, c, st);
}
int MPI_Send_init(const void *b, int n, MPI_Datatype t, int d, int tag, MPI_Comm c, MPI_Request *r) {
    int e = PMPI_Send_init(b, n, t, d, tag, c, r); remember(*r, size_of(n, t)); return e;
}
int MPI_Recv_init(void *b, int n, MPI_Datatype t, int s, int tag, MPI_Comm c, MPI_Request *r) {
    int e = PMPI_Recv_init(b, n, t, s, tag, c, r); remember(*r, -1); return e;
}
int MPI_Start(MPI_Request *r) { started(*r); return PMPI_Start(r); }
int MPI_Startall(int n, MPI_Request r[]) { for (int i = 0; i < n; i++) started(r[i]); return PMPI_Startall(n, r); }

int MPI_Allreduce(const void *s, void *r, int n, MPI_Datatype t, MPI_Op o, MPI_Comm c) {
    collective(reductions, size_of(n, t)); return PMPI_Allreduce(s, r, n, t, o, c);
}
int MPI_Iallreduce(const void *s, void *r, int n, MPI_Datatype t, MPI_Op o, MPI_Comm c, MPI_Request *q) {
    collective(reductions, size_of(n, t)); return PMPI_Iallreduce(s, r, n, t, o, c, q);
}
int MPI_Reduce(const void *s, void *r, int n, MPI_Datatype t, MPI_Op o, int root, MPI_Comm c) {
    collective(reductions, size_of(n, t)); return PMPI_Reduce(s, r, n, t, o, root, c);
}
int MPI_Bcast(void *b, int n, MPI_Datatype t, int root, MPI_Comm c) {
    collective(others, size_of(n, t)); return PMPI_Bcast(b, n, t, root, c);
}
int MPI_Barrier(MPI_Comm c) { collective(others, 0); return PMPI_Barrier(c); }
int MPI_Allgather(const void *s, int n, MPI_Datatype t, void *r, int rn, MPI_Datatype rt, MPI_Comm c) {
    int size; PMPI_Comm_size(c, &size);
    collective(others, size * size_of(rn, rt)); return PMPI_Allgather(s, n, t, r, rn, rt, c);
}
int MPI_Allgatherv(const void *s, int n, MPI_Datatype t, void *r, const int rn[], const int d[], MPI_Datatype rt,
                   MPI_Comm c) {
    int size; long long all = 0; PMPI_Comm_size(c, &size);
    for (int i = 0; i < size; i++) all += rn[i];
    collective(others, size_of(all, rt)); return PMPI_Allgatherv(s, n, t, r, rn, d, rt, c);
}
int MPI_Alltoall(const void *s, int n, MPI_Datatype t, void *r, int rn, MPI_Datatype rt, MPI_Comm c) {
    int size; PMPI_Comm_size(c, &size);
    collective(others, size * size_of(rn, rt)); return PMPI_Alltoall(s, n, t, r, rn, rt, c);
}
int MPI_Alltoallv(const void *s, const int n[], const int d[], MPI_Datatype t, void *r, const int rn[], const int rd[],
                  MPI_Datatype rt, MPI_Comm c) {
    int size; long long all = 0; PMPI_Comm_size(c, &size);
    for (int i = 0; i < size; i++) all += rn[i];
    collective(others, size_of(all, rt)); return PMPI_Alltoallv(s, n, d, t, r, rn, rd, rt, c);
}
int MPI_Finalize(void) {
    const char *base = getenv("COULOMB_MPI_COUNTS");
    int rank; PMPI_Comm_rank(MPI_COMM_WORLD, &rank);
    if (base) {
        char name[4096];
        snprintf(name, sizeof name, "%s.%d", base, rank);
        FILE *file = fopen(name, "w");
        for (int k = 0; file && k < PHASES; k++)
            fprintf(file, "%d %lld %lld %lld %lld %lld\n", k, messages[k], sent[k], reductions[k], others[k], largest[k]);
        if (file) fclose(file);
    }
    return PMPI_Finalize();
}
