/* sin and cos of all finite numbers, off by less than one unit in the last place, NaN of
 * others; the same bits wherever + - * are IEEE 754's: no library of the system's is asked,
 * whose versions and processors differ. bus/mathematics.py has the same in NumPy. */

#ifndef MATHEMATICS_H
#define MATHEMATICS_H

double sine(double x);
double cosine(double x);
void sine_and_cosine(double x, double *s, double *c);

/* x^(-1/5), x^(-1/8), x^(-1/10) of 0 < x, finite, off by a few units in the last place. */
double inverse_fifth_root(double x);
double inverse_eighth_root(double x);
double inverse_tenth_root(double x);

#endif
