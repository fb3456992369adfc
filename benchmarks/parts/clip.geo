SetFactory("OpenCASCADE");
// U clip, mm: two arms 60 long, gap 10, thickness 4, width 20; its lower arm's inner face rests on a plate's edge
Box(1) = {0,0,0, 64,20,4};
Box(2) = {0,0,0, 4,20,18};
Box(3) = {0,0,14, 64,20,4};
BooleanUnion(4) = { Volume{1}; Delete; }{ Volume{2,3}; Delete; };
Physical Volume("steel") = {4};
Physical Surface("jaw") = Surface In BoundingBox {3.9,-1,13.9,65,21,14.1};
Physical Surface("base") = Surface In BoundingBox {-.1,-1,-.1,65,21,.1};
Physical Surface("end") = Surface In BoundingBox {63.9,-1,13.9,64.1,21,18.1};
Mesh.MeshSizeMax = 2.5; Mesh.MeshSizeMin=1.5;
