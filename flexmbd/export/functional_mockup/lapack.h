#ifndef FLEXMBD_LAPACK_H
#define FLEXMBD_LAPACK_H

void machine_dgetrf(const int *rows, const int *columns, double *a, const int *lda, int *pivot, int *info);
void machine_dgetrs(const char *transposed, const int *size, const int *sides, const double *a, const int *lda,
                    const int *pivot, double *b, const int *ldb, int *info);

#endif
