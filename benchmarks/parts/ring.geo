SetFactory("OpenCASCADE");
// lower half of a ring, r 40..48, width 15: pressed down on a plane at its ends
Cylinder(1)={0,0,0, 0,15,0, 48, 2*Pi};
Cylinder(2)={0,-1,0, 0,17,0, 40, 2*Pi};
BooleanDifference(3)={Volume{1}; Delete;}{Volume{2}; Delete;};
Box(4)={-60,-10,0, 120,40,60};
BooleanDifference(5)={Volume{3}; Delete;}{Volume{4}; Delete;};
Physical Volume("steel")={5};
s()=Surface In BoundingBox{-49,-1,-49,49,16,0.1};
outer()={};
Physical Surface("ends")=Surface In BoundingBox{-49,-1,-.1,49,16,.1};
For k In {0:#s()-1}
  b()=BoundingBox Surface{s(k)};
  If (b(2)<-47 && b(4)-b(1)>14)
    outer()+={s(k)};
  EndIf
EndFor
Physical Surface("outer")=outer();
Mesh.MeshSizeMax = 3; Mesh.MeshSizeMin=1;
