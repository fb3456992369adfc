// A plate of a bolted lap joint, in millimetres: the hole at the origin, the end to be gripped at x = 75.
// On the upper side a circle of the size of the washer.  The joint has three of these plates.
// gmsh -3 lap_joint.geo -o lap_joint.msh          finer: -setnumber h 2
SetFactory("OpenCASCADE");
DefineConstant[ h = 5, layers = 2 ];

long = 75; edge = 25; half = 20; thick = 6; hole = 5.5; washer = 11;

Rectangle(1) = {-edge, -half, 0, edge + long, 2 * half};
Disk(2) = {0, 0, 0, washer};
Disk(3) = {0, 0, 0, hole};
flat() = BooleanFragments{ Surface{1}; Delete; }{ Surface{2}; Surface{3}; Delete; };
e = 1e-3;
inside() = Surface In BoundingBox {-hole - e, -hole - e, -e, hole + e, hole + e, e};
Recursive Delete { Surface{inside()}; }

Mesh.MeshSizeMax = h;
Mesh.MeshSizeFromCurvature = 12;
Mesh.RecombineAll = 1;
Mesh.RecombinationAlgorithm = 2;
Mesh.SubdivisionAlgorithm = 0;
all() = Surface{:};
Extrude {0, 0, thick} { Surface{all()}; Layers{layers}; Recombine; }

Physical Volume("plate") = {Volume{:}};
Physical Surface("lower") = Surface In BoundingBox {-edge - e, -half - e, -e, long + e, half + e, e};
upper() = Surface In BoundingBox {-edge - e, -half - e, thick - e, long + e, half + e, thick + e};
seat() = Surface In BoundingBox {-washer - e, -washer - e, thick - e, washer + e, washer + e, thick + e};
Physical Surface("upper") = {upper()};
Physical Surface("washer") = {seat()};
Physical Surface("end") = Surface In BoundingBox {long - e, -half - e, -e, long + e, half + e, thick + e};
Physical Surface("hole") = Surface In BoundingBox {-hole - e, -hole - e, -e, hole + e, hole + e, thick + e};

Mesh.MshFileVersion = 4.1;
Mesh.Binary = 1;
