/* Counts what each rank sends over MPI, and prints it when MPI ends: count_messages.so is loaded before MPI.

   gcc -shared -fPIC -O2 count_messages.c -o count_messages.so $(mpicc -showme:compile)

   Point-to-point messages and their bytes are those that this rank sends; collectives are counted by calls, with the
   bytes that this rank brings to each. */

#include <mpi.h>
#include <stdio.h>
#include <stdlib.h>

static long long messages, bytes, calls, shared;

static void sent(int count, MPI_Datatype type)
{
    int size;
    PMPI_Type_size(type, &size);
    messages += 1;
    bytes += (long long)count * size;
}

static void met(long long count, MPI_Datatype type)
{
    int size;
    PMPI_Type_size(type, &size);
    calls += 1;
    shared += count * size;
}

int MPI_Send(const void *b, int n, MPI_Datatype t, int to, int tag, MPI_Comm c)
{
    sent(n, t);
    return PMPI_Send(b, n, t, to, tag, c);
}

int MPI_Isend(const void *b, int n, MPI_Datatype t, int to, int tag, MPI_Comm c, MPI_Request *r)
{
    sent(n, t);
    return PMPI_Isend(b, n, t, to, tag, c, r);
}

int MPI_Issend(const void *b, int n, MPI_Datatype t, int to, int tag, MPI_Comm c, MPI_Request *r)
{
    sent(n, t);
    return PMPI_Issend(b, n, t, to, tag, c, r);
}

int MPI_Startall(int n, MPI_Request r[])
{
    messages += n / 2; /* PETSc starts as many receives as sends */
    return PMPI_Startall(n, r);
}

int MPI_Bcast(void *b, int n, MPI_Datatype t, int root, MPI_Comm c)
{
    met(n, t);
    return PMPI_Bcast(b, n, t, root, c);
}

int MPI_Allreduce(const void *s, void *r, int n, MPI_Datatype t, MPI_Op op, MPI_Comm c)
{
    met(n, t);
    return PMPI_Allreduce(s, r, n, t, op, c);
}

int MPI_Reduce(const void *s, void *r, int n, MPI_Datatype t, MPI_Op op, int root, MPI_Comm c)
{
    met(n, t);
    return PMPI_Reduce(s, r, n, t, op, root, c);
}

int MPI_Allgather(const void *s, int n, MPI_Datatype t, void *r, int m, MPI_Datatype u, MPI_Comm c)
{
    met(n, t);
    return PMPI_Allgather(s, n, t, r, m, u, c);
}

int MPI_Barrier(MPI_Comm c)
{
    calls += 1;
    return PMPI_Barrier(c);
}

/* The same of Fortran, in which MUMPS is written. */

void pmpi_send_(void *, MPI_Fint *, MPI_Fint *, MPI_Fint *, MPI_Fint *, MPI_Fint *, MPI_Fint *);
void pmpi_isend_(void *, MPI_Fint *, MPI_Fint *, MPI_Fint *, MPI_Fint *, MPI_Fint *, MPI_Fint *, MPI_Fint *);
void pmpi_bcast_(void *, MPI_Fint *, MPI_Fint *, MPI_Fint *, MPI_Fint *, MPI_Fint *);
void pmpi_allreduce_(void *, void *, MPI_Fint *, MPI_Fint *, MPI_Fint *, MPI_Fint *, MPI_Fint *);
void pmpi_reduce_(void *, void *, MPI_Fint *, MPI_Fint *, MPI_Fint *, MPI_Fint *, MPI_Fint *, MPI_Fint *);

void mpi_send_(void *b, MPI_Fint *n, MPI_Fint *t, MPI_Fint *to, MPI_Fint *tag, MPI_Fint *c, MPI_Fint *e)
{
    sent(*n, MPI_Type_f2c(*t));
    pmpi_send_(b, n, t, to, tag, c, e);
}

void mpi_isend_(void *b, MPI_Fint *n, MPI_Fint *t, MPI_Fint *to, MPI_Fint *tag, MPI_Fint *c, MPI_Fint *r, MPI_Fint *e)
{
    sent(*n, MPI_Type_f2c(*t));
    pmpi_isend_(b, n, t, to, tag, c, r, e);
}

void mpi_bcast_(void *b, MPI_Fint *n, MPI_Fint *t, MPI_Fint *root, MPI_Fint *c, MPI_Fint *e)
{
    met(*n, MPI_Type_f2c(*t));
    pmpi_bcast_(b, n, t, root, c, e);
}

void mpi_allreduce_(void *s, void *r, MPI_Fint *n, MPI_Fint *t, MPI_Fint *op, MPI_Fint *c, MPI_Fint *e)
{
    met(*n, MPI_Type_f2c(*t));
    pmpi_allreduce_(s, r, n, t, op, c, e);
}

void mpi_reduce_(void *s, void *r, MPI_Fint *n, MPI_Fint *t, MPI_Fint *op, MPI_Fint *root, MPI_Fint *c, MPI_Fint *e)
{
    met(*n, MPI_Type_f2c(*t));
    pmpi_reduce_(s, r, n, t, op, root, c, e);
}

int MPI_Finalize(void)
{
    int rank;
    PMPI_Comm_rank(MPI_COMM_WORLD, &rank);
    printf("count_messages rank %d: %lld messages, %lld bytes, %lld collectives, %lld bytes\n", rank, messages, bytes,
           calls, shared);
    return PMPI_Finalize();
}
