SetFactory("OpenCASCADE");
Box(1)={0,0,0,100,80,4};
Cylinder(2)={30,40,-1,0,0,10,10};
BooleanDifference(3)={Volume{1}; Delete;}{Volume{2}; Delete;};
Physical Volume("steel")={3};
Physical Surface("sole")=Surface In BoundingBox{-1,-1,-.1,101,81,.1};
Physical Surface("bore")=Surface In BoundingBox{19,29,-.1,41,51,4.1};
Physical Surface("edge")=Surface In BoundingBox{99.9,-1,-.1,100.1,81,4.1};
Mesh.MeshSizeMax = 4; Mesh.MeshSizeMin=2;
