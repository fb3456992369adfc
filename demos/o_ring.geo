// Upper half of the section of an O-ring of 4 mm, mean radius 20 mm: quadrilaterals, millimetres.
//     gmsh -2 o_ring.geo
R = 20; a = 2; size = 0.45;
angle() = {0, 50, 130, 180}; // degrees: the wall, the lid and the fluid touch the parts between
For i In {0:3}
  Point(i + 1) = {R + a * Cos(angle(i) * Pi / 180), a * Sin(angle(i) * Pi / 180), 0, size};
EndFor
Point(5) = {R, 0, 0, size};
For i In {1:3}
  Circle(i) = {i, 5, i + 1};
EndFor
Line(4) = {4, 5};
Line(5) = {5, 1};
Curve Loop(1) = {1, 2, 3, 4, 5};
Plane Surface(1) = {1};
Mesh.Algorithm = 6;
Mesh.SubdivisionAlgorithm = 1; // quadrilaterals alone
Recombine Surface{1};
Mesh.MshFileVersion = 4.1;
Physical Curve("outside") = {1};
Physical Curve("above") = {2};
Physical Curve("inside") = {3};
Physical Curve("middle") = {4, 5};
Physical Surface("rubber") = {1};
