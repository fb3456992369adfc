// A machine foot, in millimetres: a steel plate on a rubber pad with rounded corners and a hole for a bolt.
// gmsh -3 foot.geo -o foot.msh
SetFactory("OpenCASCADE");

Rectangle(1) = {-40, -30, 0, 80, 60, 12};      // corner radius 12
Disk(2) = {0, 0, 0, 9};
BooleanDifference(3) = { Surface{1}; Delete; }{ Surface{2}; Delete; };
Extrude {0, 0, 20} { Surface{3}; Layers{3}; }      // rubber
rubber() = Volume{:};
top() = Surface In BoundingBox {-41, -31, 19.9, 41, 31, 20.1};
Extrude {0, 0, 8} { Surface{top(0)}; Layers{2}; }  // steel

Physical Volume("rubber") = {1};
Physical Volume("steel") = {2};
Physical Surface("sole") = Surface In BoundingBox {-41, -31, -0.1, 41, 31, 0.1};
Physical Surface("seat") = Surface In BoundingBox {-41, -31, 27.9, 41, 31, 28.1};

Mesh.MeshSizeMax = 8;
Mesh.MshFileVersion = 4.1;
Mesh.Binary = 1;
