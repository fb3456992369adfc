// A disc brake, in millimetres: half of the disc (part 1), the pad (part 2), and the anvil of its carrier (part 3).
// The axis of the disc is the z axis, its middle plane z = 0; the pad lies on it about the x axis; the anvil holds its end at y = 40.
// gmsh -3 disc_brake.geo -setnumber part 1 -o disc.msh      part 2: pad.msh      part 3: carrier.msh
DefineConstant[ part = 1, n = 1 ];

hub = 60; rim = 120; thick = 6;                // the disc
inner = 76; outer = 114; end = 40;             // the pad
lining = 9; back = 6; piston = 17;             // on the back the circle of the piston
e = 1e-2;
SetFactory("OpenCASCADE");

If (part == 1)
  Disk(1) = {0, 0, 0, rim};
  Disk(2) = {0, 0, 0, hub};
  BooleanDifference(3) = { Surface{1}; Delete; }{ Surface{2}; Delete; };
  size = 8 / n;
  all() = {3};
  Extrude {0, 0, thick} { Surface{all()}; Layers{2}; Recombine; }
  Physical Volume("disc") = {Volume{:}};
  Physical Surface("middle") = Surface In BoundingBox {-rim - e, -rim - e, -e, rim + e, rim + e, e};
  Physical Surface("face") = Surface In BoundingBox {-rim - e, -rim - e, thick - e, rim + e, rim + e, thick + e};
  Physical Surface("hub") = Surface In BoundingBox {-hub - e, -hub - e, -e, hub + e, hub + e, thick + e};
ElseIf (part == 2)
  low = thick;
  size = 6 / n;
  Point(1) = {Sqrt(inner^2 - end^2), -end, low};
  Point(2) = {Sqrt(outer^2 - end^2), -end, low};
  Point(3) = {Sqrt(outer^2 - end^2), end, low};
  Point(4) = {Sqrt(inner^2 - end^2), end, low};
  Point(5) = {0, 0, low};
  Line(1) = {1, 2};
  Circle(2) = {2, 5, 3};
  Line(3) = {3, 4};
  Circle(4) = {4, 5, 1};
  Curve Loop(1) = {1, 2, 3, 4};
  Plane Surface(1) = {1};
  x = (inner + outer) / 2;
  Disk(2) = {x, 0, low, piston};
  flat() = BooleanFragments{ Surface{1}; Delete; }{ Surface{2}; Delete; };
  Extrude {0, 0, lining} { Surface{flat()}; Layers{3}; Recombine; }
  mid() = Surface In BoundingBox {-e, -outer, low + lining - e, outer + e, outer, low + lining + e};
  Extrude {0, 0, back} { Surface{mid()}; Layers{2}; Recombine; }
  high = low + lining + back;
  soft() = Volume In BoundingBox {-e, -outer, low - e, outer + e, outer, low + lining + e};
  stiff() = Volume In BoundingBox {-e, -outer, low + lining - e, outer + e, outer, high + e};
  Physical Volume("lining") = {soft()};
  Physical Volume("back") = {stiff()};
  Physical Surface("rub") = Surface In BoundingBox {-e, -outer, low - e, outer + e, outer, low + e};
  Physical Surface("piston") = Surface In BoundingBox {x - piston - e, -piston - e, high - e, x + piston + e, piston + e, high + e};
  Physical Surface("end") = Surface In BoundingBox {-e, end - e, low + lining - e, outer + e, end + e, high + e};
Else
  low = thick + lining - 1;
  high = low + back + 6;
  size = 5 / n;
  Rectangle(1) = {66, end, low, 40, 10};
  Extrude {0, 0, high - low} { Surface{1}; Layers{3}; Recombine; }
  Physical Volume("carrier") = {Volume{:}};
  Physical Surface("anvil") = Surface In BoundingBox {-e, end - e, low - e, outer + e, end + e, high + e};
  Physical Surface("bolted") = Surface In BoundingBox {-e, end + 10 - e, low - e, outer + e, end + 10 + e, high + e};
EndIf

Mesh.MeshSizeMax = size;
Mesh.RecombineAll = 1;
Mesh.RecombinationAlgorithm = 3;
Mesh.MshFileVersion = 4.1;
Mesh.Binary = 1;
