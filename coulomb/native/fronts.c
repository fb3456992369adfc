/* The kernels of fronts.h in single and in double precision. */

#include <string.h>

#define REAL float
#define NAME(function) function##_float32
#include "fronts.h"

#define REAL double
#define NAME(function) function##_float64
#include "fronts.h"
