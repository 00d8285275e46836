// The mathematics of musl, which WebAssembly has too, for a program that is linked with another libm (LD_PRELOAD).
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>

static void *of_musl(const char *name) {
  static void *library;
  if (!library) library = dlopen(MUSL, RTLD_NOW | RTLD_LOCAL);
  void *found = library ? dlsym(library, name) : NULL;
  if (!found) {
    fprintf(stderr, "%s: no %s\n", MUSL, name);
    abort();
  }
  return found;
}

#define ONE(name) \
  double name(double x) { \
    static double (*of)(double); \
    if (!of) of = of_musl(#name); \
    return of(x); \
  }
#define TWO(name) \
  double name(double x, double y) { \
    static double (*of)(double, double); \
    if (!of) of = of_musl(#name); \
    return of(x, y); \
  }

ONE(sin) ONE(cos) ONE(tan) ONE(asin) ONE(acos) ONE(atan) ONE(sinh) ONE(cosh) ONE(tanh)
ONE(exp) ONE(exp2) ONE(expm1) ONE(log) ONE(log2) ONE(log10) ONE(log1p) ONE(cbrt) ONE(tgamma) ONE(lgamma) ONE(erf) ONE(erfc)
TWO(atan2) TWO(pow)
