// A shoe of a drum brake, in millimetres: a lining on a steel lever with a narrow mounting at one end.
// The axis of the drum is the y axis, its radius 100; the lining reaches from -alpha to alpha degrees from the top.
// gmsh -3 drum_brake.geo -o drum_brake.msh          finer: -setnumber n 4     longer lining: -setnumber alpha 15
DefineConstant[ n = 2, alpha = 5, thick = 4 ];

r = 100; lever = 36; width = 30;    // the drum; lining and lever; along y
b = 100; c = 50;                               // the mounting: beside the middle of the lining, and above the drum
s = r * Sin(alpha * Pi / 180); low = r * Cos(alpha * Pi / 180);
z1 = r + thick; z2 = z1 + lever; z3 = r + c;

x() = {-s, s, b - 10, b - 3, b + 3, b + 10};   // the columns of the lever
nx() = {6 * n, 5 * n, n, n, n};
For i In {0:5}
  Point(10 + i) = {x(i), -width / 2, z1};
  Point(20 + i) = {x(i), -width / 2, z2};
  Line(200 + i) = {10 + i, 20 + i};
EndFor
For i In {0:4}
  Line(100 + i) = {10 + i, 11 + i};
  Line(300 + i) = {20 + i, 21 + i};
  Curve Loop(i + 1) = {100 + i, 201 + i, -(300 + i), -(200 + i)};
  Plane Surface(i + 1) = {i + 1};
  Transfinite Curve {100 + i, 300 + i} = nx(i) + 1;
EndFor
Transfinite Curve {200:205} = 2 * n + 1;

For i In {2:5}                                 // the post of the mounting
  Point(30 + i) = {x(i), -width / 2, z3};
  Line(400 + i) = {20 + i, 30 + i};
EndFor
For i In {2:4}
  Line(500 + i) = {30 + i, 31 + i};
  Curve Loop(10 + i) = {300 + i, 401 + i, -(500 + i), -(400 + i)};
  Plane Surface(10 + i) = {10 + i};
  Transfinite Curve {500 + i} = nx(i) + 1;
EndFor
Transfinite Curve {402:405} = n + 1;

Point(40) = {0, -width / 2, 0};                // the lining
Point(41) = {-s, -width / 2, low};
Point(42) = {s, -width / 2, low};
Circle(600) = {41, 40, 42};
Line(601) = {42, 11};
Line(602) = {41, 10};
Curve Loop(20) = {600, 601, -100, -602};
Plane Surface(20) = {20};
Transfinite Curve {600} = nx(0) + 1;
Transfinite Curve {601, 602} = 2 * n + 1;

Transfinite Surface {1:5, 12:14, 20};
Recombine Surface {1:5, 12:14, 20};
Extrude {0, width, 0} { Surface{1:5, 12:14, 20}; Layers{3 * n}; Recombine; }

e = 1e-3;
Physical Surface("lining") = Surface In BoundingBox {-s - e, -width, low - e, s + e, width, r + e};
Physical Surface("piston") = Surface In BoundingBox {-s - e, -width, z2 - e, s + e, width, z2 + e};
Physical Surface("mounting") = Surface In BoundingBox {b - 3 - e, -width, z3 - e, b + 3 + e, width, z3 + e};
lining() = Volume In BoundingBox {-s - e, -width, low - e, s + e, width, z1 + e};
Physical Volume("friction material") = {lining()};
steel() = Volume{:};
steel() -= {lining()};
Physical Volume("steel") = {steel()};

Mesh.MshFileVersion = 4.1;
