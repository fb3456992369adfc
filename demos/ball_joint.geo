// A ball on a stem, part 1, and its socket, part 2, in millimetres; the centre of the ball is the origin.
// gmsh -3 ball_joint.geo -setnumber part 1 -o ball.msh
// gmsh -3 ball_joint.geo -setnumber part 2 -o socket.msh       finer: -setnumber h 2.5
SetFactory("OpenCASCADE");
DefineConstant[ part = 1, h = 3.4 ];   // h: cells at the contact

radius = 15; clearance = 0.05; stem = 6; top = 24; outer = 24; deep = 24; rim = 2;
e = 1e-3;

If (part == 1)
  Sphere(1) = {0, 0, 0, radius};
  Cylinder(2) = {0, 0, 0, 0, 0, top, stem};
  BooleanUnion(3) = { Volume{1}; Delete; }{ Volume{2}; Delete; };
  Physical Volume("ball") = {3};
  Physical Surface("sphere") = Surface In BoundingBox {-radius - e, -radius - e, -radius - e, radius + e, radius + e, radius + e};
  Physical Surface("stem") = Surface In BoundingBox {-stem - e, -stem - e, top - e, stem + e, stem + e, top + e};
Else
  Cylinder(1) = {0, 0, -deep, 0, 0, deep - rim, outer};
  Sphere(2) = {0, 0, 0, radius + clearance};
  BooleanDifference(3) = { Volume{1}; Delete; }{ Volume{2}; Delete; };
  Physical Volume("socket") = {3};
  MeshSize { PointsOf { Volume{3}; } } = 2.5 * h;
  cup() = Surface In BoundingBox {-radius - 1, -radius - 1, -radius - 1, radius + 1, radius + 1, -rim + e};
  MeshSize { PointsOf { Surface{cup()}; } } = h;
  Physical Surface("cup") = {cup()};
  Physical Surface("base") = Surface In BoundingBox {-outer - e, -outer - e, -deep - e, outer + e, outer + e, -deep + e};
EndIf

Mesh.MeshSizeMax = part == 1 ? 1.3 * h : 2.5 * h;
Mesh.ElementOrder = 2;
Mesh.MshFileVersion = 4.1;
Mesh.Binary = 1;
