/* What the machine's kernels ask of LAPACK, by its names and conventions: matrices column by column, pivots from 1. */
#include "lapack.h"

#include <math.h>

void machine_dgetrf(const int *rows, const int *columns, double *a, const int *lda, int *pivot, int *info) {
    int n = *columns, stride = *lda;
    (void)rows; /* the same */
    *info = 0;
    for (int k = 0; k < n; k++) {
        double *column = a + (long)k * stride;
        int best = k;
        for (int i = k + 1; i < n; i++)
            if (fabs(column[i]) > fabs(column[best]))
                best = i;
        pivot[k] = best + 1;
        if (!(fabs(column[best]) > 0.0)) {
            *info = *info ? *info : k + 1;
            continue;
        }
        if (best != k)
            for (int j = 0; j < n; j++) {
                double kept = a[(long)j * stride + k];
                a[(long)j * stride + k] = a[(long)j * stride + best];
                a[(long)j * stride + best] = kept;
            }
        for (int i = k + 1; i < n; i++)
            column[i] /= column[k];
        for (int j = k + 1; j < n; j++) {
            double *other = a + (long)j * stride, factor = other[k];
            if (factor != 0.0)
                for (int i = k + 1; i < n; i++)
                    other[i] -= column[i] * factor;
        }
    }
}

/* Only the transposed system is ever asked for: A^T x = U^T L^T P x. */
void machine_dgetrs(const char *transposed, const int *size, const int *sides, const double *a, const int *lda,
                    const int *pivot, double *b, const int *ldb, int *info) {
    int n = *size;
    (void)transposed;
    *info = 0;
    for (int side = 0; side < *sides; side++) {
        double *x = b + (long)side * *ldb;
        for (int j = 0; j < n; j++) {
            const double *column = a + (long)j * *lda;
            double sum = x[j];
            for (int i = 0; i < j; i++)
                sum -= column[i] * x[i];
            x[j] = sum / column[j];
        }
        for (int j = n - 1; j >= 0; j--) {
            const double *column = a + (long)j * *lda;
            double sum = x[j];
            for (int i = j + 1; i < n; i++)
                sum -= column[i] * x[i];
            x[j] = sum;
        }
        for (int k = n - 1; k >= 0; k--) {
            double kept = x[k];
            x[k] = x[pivot[k] - 1];
            x[pivot[k] - 1] = kept;
        }
    }
}
