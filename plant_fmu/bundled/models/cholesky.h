/* A x = b by Cholesky's factors of A, symmetric and positive definite; NaN where it is not. */

#ifndef CHOLESKY_H
#define CHOLESKY_H

#include <math.h>

#include "variables.h"

/* Replaces b by the solution x. The lower half of A is replaced by its factor, with the reciprocals
 * of the diagonal. */
static inline void cholesky_solve(int n, double A[M][M], double b[M])
{
    for (int i = 0; i < n; ++i) {
        for (int j = 0; j < i; ++j) {
            for (int k = 0; k < j; ++k)
                A[i][j] -= A[i][k] * A[j][k];
            A[i][j] *= A[j][j];
            A[i][i] -= A[i][j] * A[i][j];
            b[i] -= A[i][j] * b[j];
        }
        A[i][i] = 1.0 / sqrt(A[i][i]);
        b[i] *= A[i][i];
    }
    for (int i = n - 1; i >= 0; --i) {
        for (int k = i + 1; k < n; ++k)
            b[i] -= A[k][i] * b[k];
        b[i] *= A[i][i];
    }
}

#endif
