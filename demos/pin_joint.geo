// A clevis, a lug and the pin that joins them, millimetres; the half y > 0.  Three volumes that share no surface, as an
// assembly from a STEP file (Merge "assembly.step"), with names for what is held and loaded alone.
//     gmsh -3 pin_joint.geo
SetFactory("OpenCASCADE");
R = 10; clearance = 0.02; side = 0.05;

Cylinder(1) = {0, 0, 0, 0, 18, 0, R};                            // the pin

Box(2) = {0, 0, -16, 45, 5, 32};                                 // the lug: an eye on a strip
Cylinder(3) = {0, 0, 0, 0, 5, 0, 16};
BooleanUnion(4) = { Volume{2}; Delete; }{ Volume{3}; Delete; };
Cylinder(5) = {0, -1, 0, 0, 7, 0, R + clearance};
BooleanDifference(6) = { Volume{4}; Delete; }{ Volume{5}; Delete; };

Box(7) = {-30, 5 + side, -16, 30, 8, 32};                        // the clevis: an eye on an arm, and its base
Cylinder(8) = {0, 5 + side, 0, 0, 8, 0, 16};
Box(9) = {-45, 0, -16, 20, 13 + side, 32};
BooleanUnion(10) = { Volume{7}; Delete; }{ Volume{8, 9}; Delete; };
Cylinder(11) = {0, 4, 0, 0, 12, 0, R + clearance};
BooleanDifference(12) = { Volume{10}; Delete; }{ Volume{11}; Delete; };

Physical Volume("pin") = {1};
Physical Volume("lug") = {6};
Physical Volume("clevis") = {12};
Physical Surface("base") = Surface In BoundingBox {-46, -1, -17, -44, 14, 17};
Physical Surface("end") = Surface In BoundingBox {44, -1, -17, 46, 6, 17};
Physical Surface("middle") = Surface In BoundingBox {-46, -0.1, -17, 46, 0.1, 17};

Mesh.ElementOrder = 2;
Mesh.MeshSizeMax = 8;
Mesh.MeshSizeFromCurvature = 16;
Mesh.MshFileVersion = 4.1;
