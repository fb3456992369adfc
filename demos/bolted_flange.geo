// Two flanges of pipes with a gasket between them and four bolts, in millimetres: gmsh -3 bolted_flange.geo
// Bodies share no nodes; every bolt is cut in the middle of its shank.
SetFactory("OpenCASCADE");

bore = 20; outer = 60; pipe = 28; thick = 14; neck = 40; // radii and lengths
circle = 44; hole = 7; shank = 6; head = 10; tall = 7; gasket = 3;

// Flange above the gasket, and its mirror image
Cylinder(1) = {0, 0, gasket / 2, 0, 0, thick, outer};
Cylinder(2) = {0, 0, gasket / 2 + thick, 0, 0, neck, pipe};
BooleanUnion(3) = { Volume{1}; Delete; }{ Volume{2}; Delete; };
Cylinder(4) = {0, 0, 0, 0, 0, 100, bore};
For i In {0:3}
  angle = Pi / 4 + i * Pi / 2;
  Cylinder(5 + i) = {circle * Cos(angle), circle * Sin(angle), 0, 0, 0, 30, hole};
EndFor
BooleanDifference(10) = { Volume{3}; Delete; }{ Volume{4, 5, 6, 7, 8}; Delete; };
lower() = Symmetry {0, 0, 1, 0} { Duplicata { Volume{10}; } };

Cylinder(12) = {0, 0, -gasket / 2, 0, 0, gasket, pipe};
Cylinder(13) = {0, 0, -gasket / 2, 0, 0, gasket, bore};
BooleanDifference(14) = { Volume{12}; Delete; }{ Volume{13}; Delete; };

// Bolts: two halves that share the section
bolts() = {};
top = gasket / 2 + thick;
For i In {0:3}
  angle = Pi / 4 + i * Pi / 2;
  x = circle * Cos(angle); y = circle * Sin(angle);
  a = 20 + 10 * i;
  Cylinder(a) = {x, y, 0, 0, 0, top, shank};
  Cylinder(a + 1) = {x, y, top, 0, 0, tall, head};
  BooleanUnion(a + 2) = { Volume{a}; Delete; }{ Volume{a + 1}; Delete; };
  Cylinder(a + 3) = {x, y, -top, 0, 0, top, shank};
  Cylinder(a + 4) = {x, y, -top - tall, 0, 0, tall, head};
  BooleanUnion(a + 5) = { Volume{a + 3}; Delete; }{ Volume{a + 4}; Delete; };
  halves() = BooleanFragments{ Volume{a + 2}; Delete; }{ Volume{a + 5}; Delete; };
  eps = 0.1;
  cut() = Surface In BoundingBox {x - shank - eps, y - shank - eps, -eps, x + shank + eps, y + shank + eps, eps};
  Physical Surface(Sprintf("section_%g", i + 1)) = cut();
  bolts() += halves();
EndFor

Physical Volume("steel") = {10, lower(), bolts()};
Physical Volume("gasket") = {14};
eps = 0.1;
Physical Surface("pulled") = Surface In BoundingBox {-pipe - eps, -pipe - eps, top + neck - eps, pipe + eps, pipe + eps, top + neck + eps};
Physical Surface("base") = Surface In BoundingBox {-pipe - eps, -pipe - eps, -top - neck - eps, pipe + eps, pipe + eps, -top - neck + eps};

Mesh.MeshSizeMax = 16;
Mesh.MeshSizeFromCurvature = 10;
Mesh.MshFileVersion = 4.1;
