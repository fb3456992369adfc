/* The shapes of blocks, each with the kernels of the file KERNELS: 3 x 3 between nodes, 3 x 6 between nodes and aggregates
of nodes with six rigid motions, 6 x 6 between aggregates.  BR and BC are rows and columns of a block, LC the next power
of two of BC, DC a vector of LC doubles, UP converts LC floats to doubles; NAME gives every function its shape. */

#define BR 3
#define BC 3
#define LC 4
#define UP up4
#define DC d4
#define NAME(function) function##_3_3
#include KERNELS
#undef BR
#undef BC
#undef LC
#undef UP
#undef DC
#undef NAME

#define BR 3
#define BC 6
#define LC 8
#define UP up8
#define DC d8
#define NAME(function) function##_3_6
#include KERNELS
#undef BR
#undef BC
#undef LC
#undef UP
#undef DC
#undef NAME

#define BR 6
#define BC 6
#define LC 8
#define UP up8
#define DC d8
#define NAME(function) function##_6_6
#include KERNELS
#undef BR
#undef BC
#undef LC
#undef UP
#undef DC
#undef NAME
