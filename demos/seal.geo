// Half of a slice of a rubber seal, a rod of 4 mm in diameter, millimetres; the half x > 0, one cell thick.
//     gmsh -3 seal.geo
r = 2; size = 0.28; t = 0.4;
a() = {-90, -40, -32, 32, 40, 90}; // degrees: the floor, the wall and the lid touch the parts between, with gaps
For i In {0:5}
  Point(i + 1) = {r * Cos(a(i) * Pi / 180), 0, r * Sin(a(i) * Pi / 180), size};
EndFor
Point(7) = {0, 0, 0, size};
For i In {1:5}
  Circle(i) = {i, 7, i + 1};
EndFor
Line(6) = {6, 7};
Line(7) = {7, 1};
Curve Loop(1) = {1, 2, 3, 4, 5, 6, 7};
Plane Surface(1) = {1};
Mesh.Algorithm = 6;
Mesh.SubdivisionAlgorithm = 1; // quadrilaterals alone
Recombine Surface{1};
Mesh.MshFileVersion = 4.1;
slice[] = Extrude {0, t, 0} { Surface{1}; Layers{1}; Recombine; };
Physical Volume("rubber") = {slice[1]};
Physical Surface("below") = {slice[2]};
Physical Surface("beside") = {slice[4]};
Physical Surface("above") = {slice[6]};
Physical Surface("middle") = {slice[7], slice[8]};
Physical Surface("front") = {1};
Physical Surface("back") = {slice[0]};
