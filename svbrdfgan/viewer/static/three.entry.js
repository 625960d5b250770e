// What viewer.js takes of three.js. README.md says how three.bundle.js is made of it.
export {
  BackSide,
  CircleGeometry,
  ClampToEdgeWrapping,
  DataTexture,
  EquirectangularReflectionMapping,
  Group,
  HalfFloatType,
  LinearFilter,
  LinearMipmapLinearFilter,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  NeutralToneMapping,
  NoColorSpace,
  PerspectiveCamera,
  RGBAFormat,
  Scene,
  SphereGeometry,
  SRGBColorSpace,
  Texture,
  Vector3,
  WebGLRenderer,
} from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
export { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
