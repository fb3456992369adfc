/* The shapes of blocks, each with the kernels of the file KERNELS: 3 x 3 between nodes, 3 x 6 between nodes and aggregates
of nodes with six rigid motions, 6 x 6 between aggregates.  BR and BC are rows and columns of a block, LC the next power
of two of BC; a row is PARTS vectors of four numbers; NAME gives every function its shape. */

#define PARTS (LC / 4)

#define BR 3
#define BC 3
#define LC 4
#define NAME(function) function##_3_3
#include KERNELS
#undef BR
#undef BC
#undef LC
#undef NAME

#define BR 3
#define BC 6
#define LC 8
#define NAME(function) function##_3_6
#include KERNELS
#undef BR
#undef BC
#undef LC
#undef NAME

#define BR 6
#define BC 6
#define LC 8
#define NAME(function) function##_6_6
#include KERNELS
#undef BR
#undef BC
#undef LC
#undef NAME

#undef PARTS
