SetFactory("OpenCASCADE");
// A lug on a pin, millimetres; the half y > 0.  The pin is held where it is in the clevis, the lug is pulled
R = 10; clearance = .02;
Cylinder(1) = {0,0,0, 0,5,0, R};
Cylinder(2) = {0,5,0, 0,8,0, R};
BooleanFragments{ Volume{1}; Delete; }{ Volume{2}; Delete; }
Box(4) = {-16,0,-16, 61,5,32};
Cylinder(5) = {0,-1,0, 0,7,0, R + clearance};
BooleanDifference(6) = { Volume{4}; Delete; }{ Volume{5}; Delete; };
Physical Volume("pin") = {1, 2};
Physical Volume("lug") = {6};
Physical Surface("round") = 1;
Physical Surface("seat") = 4;
Physical Surface("middle") = {3, 7};
Physical Surface("eye") = 12;
Physical Surface("end") = 11;
Mesh.MeshSizeMax = 4; Mesh.MeshSizeFromCurvature = 24;
