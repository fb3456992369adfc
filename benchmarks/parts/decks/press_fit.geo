SetFactory("OpenCASCADE");
// A quarter of a hub on a tube, millimetres; the radii overlap by 0.02
Cylinder(1) = {0,0,-5, 0,0,40, 20, Pi/2};
Cylinder(2) = {0,0,-6, 0,0,42, 12, Pi/2};
BooleanDifference(3) = { Volume{1}; Delete; }{ Volume{2}; Delete; };
Cylinder(4) = {0,0,0, 0,0,25, 36, Pi/2};
Cylinder(5) = {0,0,-1, 0,0,27, 19.98, Pi/2};
BooleanDifference(6) = { Volume{4}; Delete; }{ Volume{5}; Delete; };
Mesh.MeshSizeMax = 4; Mesh.MeshSizeFromCurvature = 32;
Physical Volume("tube") = {3};
Physical Volume("hub") = {6};
Physical Surface("outside") = 1;
Physical Surface("inside") = 6;
Physical Surface("bore") = 12;
Physical Surface("stop") = 8;
Physical Surface("x0") = {3, 9};
Physical Surface("y0") = {5, 11};
