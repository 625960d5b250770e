// The page of `svbrdfgan view`: a clean model, a layer over one further UV set that is composited as svbrdfgan does,
// and a light. Documents come from the server that sent the page, or from the page itself.
"use strict";
(async () => {
  const T = THREE;
  const byId = (id) => document.getElementById(id);
  const status = byId("status");
  const stored = JSON.parse(byId("stored").textContent);
  const token = new URLSearchParams(location.search).get("token") || "";

  const say = (text, kind = "") => {
    status.textContent = text;
    status.className = kind;
  };

  class Superseded extends Error {}

  async function ask(path) {
    const answer = await fetch(path, { headers: { "X-Token": token } });
    if (answer.status === 204) throw new Superseded();
    if (!answer.ok) throw new Error((await answer.json()).error);
    return answer;
  }
  const json = async (path) => (path in stored ? stored[path] : (await ask(path)).json());
  const bytes = async (path) => {
    if (!(path in stored)) return (await ask(path)).arrayBuffer();
    return Uint8Array.from(atob(stored[path]), (letter) => letter.charCodeAt(0)).buffer;
  };

  async function texture(uri, colors) {
    const blob = await (await fetch(uri)).blob();
    const options = { premultiplyAlpha: "none", colorSpaceConversion: "none" };
    const made = new T.Texture(await createImageBitmap(blob, options));
    made.flipY = false;
    made.colorSpace = colors ? T.SRGBColorSpace : T.NoColorSpace;
    made.wrapS = made.wrapT = T.ClampToEdgeWrapping;
    made.minFilter = T.LinearMipmapLinearFilter;
    made.anisotropy = 8;
    made.needsUpdate = true;
    return made;
  }

  // ---- the layer in three.js's shaders

  const flat = (values) => {
    const made = new T.DataTexture(new Uint8Array(values), 1, 1, T.RGBAFormat);
    made.needsUpdate = true;
    return made;
  };
  const layer = {
    layerColor: { value: flat([0, 0, 0, 0]) },
    layerGloss: { value: flat([255, 255, 0, 255]) },
    layerRelief: { value: flat([128, 128, 255, 255]) },
    layerShare: { value: 0 },
    layerUse: { value: new T.Vector3(1, 1, 1) },
    layerHas: { value: new T.Vector3(1, 0, 0) },
    look: { value: 0 },
  };

  const declared = `
    uniform sampler2D layerColor, layerGloss, layerRelief;
    uniform float layerShare;
    uniform vec3 layerUse, layerHas;
    uniform int look;
    #ifdef LAYERED
    varying vec2 vLayerUv;
    #endif
    float layerAlpha = 0.0;
    vec3 layerNormal(vec3 normal, vec2 uv, vec3 leaning) {
      vec3 place = -vViewPosition;
      vec3 q0 = dFdx(place), q1 = dFdy(place);
      vec2 s0 = dFdx(uv), s1 = dFdy(uv);
      vec3 a = cross(q1, normal), b = cross(normal, q0);
      vec3 tangent = a * s0.x + b * s1.x, bitangent = a * s0.y + b * s1.y;
      float most = max(dot(tangent, tangent), dot(bitangent, bitangent));
      float scale = most == 0.0 ? 0.0 : inversesqrt(most);
      return normalize((tangent * leaning.x - bitangent * leaning.y) * scale + normal * leaning.z);
    }
    void main() {`;
  const color = `#include <color_fragment>
    #ifdef LAYERED
      vec4 layerTexel = texture2D(layerColor, vLayerUv);
      layerAlpha = layerTexel.a * layerShare;
      float layerCover = layerUse.x * layerAlpha;
      #ifndef OPAQUE
        diffuseColor.a += layerCover * (1.0 - diffuseColor.a);
      #endif
      diffuseColor.rgb = mix(diffuseColor.rgb, layerTexel.rgb, layerCover / max(diffuseColor.a, 1e-4));
    #endif`;
  const roughness = `#include <roughnessmap_fragment>
    #ifdef LAYERED
      roughnessFactor = mix(roughnessFactor, texture2D(layerGloss, vLayerUv).g, layerUse.y * layerHas.y * layerAlpha);
    #endif`;
  const metallic = `#include <metalnessmap_fragment>
    #ifdef LAYERED
      metalnessFactor = mix(metalnessFactor, texture2D(layerGloss, vLayerUv).b, layerUse.y * layerHas.y * layerAlpha);
    #endif`;
  const relief = `#include <normal_fragment_maps>
    #ifdef LAYERED
      if (layerUse.z * layerHas.z > 0.0) {
        vec3 leaning = texture2D(layerRelief, vLayerUv).xyz * 2.0 - 1.0;
        normal = normalize(mix(normal, layerNormal(nonPerturbedNormal, vLayerUv, leaning), layerAlpha));
      }
    #endif`;
  const coats = `#include <lights_physical_fragment>
    #ifdef LAYERED
      #ifdef USE_CLEARCOAT
        material.clearcoat *= 1.0 - layerUse.y * layerAlpha;
      #endif
    #endif`;
  const emission = `#include <emissivemap_fragment>
    #ifdef LAYERED
      totalEmissiveRadiance *= 1.0 - layerUse.x * layerAlpha;
    #endif`;
  const shown = (lit) => `
      if (look > 0) {
        vec3 map = vec3(layerAlpha);
        if (look == 1) map = diffuseColor.rgb;
        ${lit ? `if (look == 2) map = vec3(roughnessFactor);
        if (look == 3) map = vec3(metalnessFactor);
        if (look == 4) map = normal * 0.5 + 0.5;` : "if (look > 1 && look < 5) map = vec3(0.5);"}
        gl_FragColor = vec4(look == 1 ? pow(map, vec3(1.0 / 2.2)) : map, gl_FragColor.a);
      }
      #include <dithering_fragment>`;

  function instrument(material, layered) {
    const made = material.clone();
    const lit = !made.isMeshBasicMaterial;
    made.onBeforeCompile = (shader) => {
      Object.assign(shader.uniforms, layer);
      if (layered) {
        shader.vertexShader = shader.vertexShader
          .replace("void main() {", "attribute vec2 layerUv; varying vec2 vLayerUv; void main() { vLayerUv = layerUv;");
      }
      let text = shader.fragmentShader.replace("#include <color_fragment>", color);
      if (lit) {
        text = text
          .replace("#include <roughnessmap_fragment>", roughness)
          .replace("#include <metalnessmap_fragment>", metallic)
          .replace("#include <normal_fragment_maps>", relief)
          .replace("#include <lights_physical_fragment>", coats)
          .replace("#include <emissivemap_fragment>", emission);
      }
      text = text.replace("#include <dithering_fragment>", shown(lit));
      const head = lit ? declared : declared.replace(/vec3 layerNormal[\s\S]*?\n    }\n/, "");
      shader.fragmentShader = (layered ? "#define LAYERED\n" : "") + text.replace("void main() {", head);
    };
    made.customProgramCacheKey = () => `svbrdfgan ${layered} ${lit}`;
    return made;
  }

  // ---- the stage

  const canvas = byId("view");
  const renderer = new T.WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
  renderer.toneMapping = T.NeutralToneMapping;
  renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
  const scene = new T.Scene();
  const camera = new T.PerspectiveCamera(24, 1, 0.01, 1000);
  const controls = new T.OrbitControls(camera, canvas);
  controls.enableDamping = true;
  controls.maxPolarAngle = Math.PI * 0.497;
  controls.listenToKeyEvents(canvas);
  const dome = new T.Mesh(new T.SphereGeometry(1, 32, 16), new T.MeshBasicMaterial({ side: T.BackSide, depthWrite: false }));
  const floor = new T.Mesh(new T.CircleGeometry(1, 64), new T.MeshBasicMaterial());
  floor.rotation.x = -Math.PI / 2;
  scene.add(dome, floor);
  let model = null, stand = null, dirty = true;
  const redraw = () => { dirty = true; };

  function resize() {
    const { clientWidth: width, clientHeight: height } = byId("stage");
    renderer.setSize(width, height, false);
    camera.aspect = width / Math.max(height, 1);
    camera.updateProjectionMatrix();
    redraw();
  }
  new ResizeObserver(resize).observe(byId("stage"));
  controls.addEventListener("change", redraw);

  function home() {
    const low = new T.Vector3(...stand.low), high = new T.Vector3(...stand.high);
    const middle = low.clone().add(high).multiplyScalar(0.5), radius = high.distanceTo(low) / 2;
    const corners = Array.from({ length: 8 }, (_, k) =>
      new T.Vector3(k & 1 ? high.x : low.x, k & 2 ? high.y : low.y, k & 4 ? high.z : low.z));
    const [azimuth, elevation] = [35, 11].map((angle) => (angle * Math.PI) / 180);
    const way = new T.Vector3(
      Math.sin(azimuth) * Math.cos(elevation), Math.sin(elevation), Math.cos(azimuth) * Math.cos(elevation));
    const right = new T.Vector3(0, 1, 0).cross(way).normalize(), top = way.clone().cross(right);
    const tangent = Math.tan((camera.fov * Math.PI) / 360);
    let distance = 1;
    for (let k = 0; k < 5; k++) { // perspective moves the middle when the distance changes; converges fast
      const seen = corners.map((corner) => {
        const at = corner.clone().sub(middle);
        return [at.dot(right), at.dot(top), at.dot(way)];
      });
      distance = 1.08 * Math.max(...seen.map(([x, y, near]) =>
        Math.max(Math.abs(x) / camera.aspect, Math.abs(y)) / tangent + near));
      for (const [axis, side] of [[right, 0], [top, 1]]) {
        const ends = seen.map((at) => at[side] / (distance - at[2]));
        middle.addScaledVector(axis, (distance * (Math.min(...ends) + Math.max(...ends))) / 2);
      }
    }
    camera.position.copy(middle).addScaledVector(way, distance);
    camera.near = radius / 200;
    camera.far = radius * 80;
    camera.updateProjectionMatrix();
    controls.target.copy(middle);
    controls.minDistance = radius / 20;
    controls.maxDistance = radius * 15;
    controls.update();
  }

  async function showModel(number) {
    say("Loading the model …");
    const [data, place] = await Promise.all([bytes(`/model/${number}`), json(`/stand/${number}`)]);
    const gltf = await new T.GLTFLoader().parseAsync(data, "");
    const turned = new T.Group(), removed = [];
    turned.applyMatrix4(new T.Matrix4().set(...place.turn[0], 0, ...place.turn[1], 0, ...place.turn[2], 0, 0, 0, 0, 1));
    gltf.scene.traverse((node) => {
      if (node.isLight || node.isCamera) removed.push(node);
      if (!node.isMesh) return;
      const mark = node.geometry.userData[state.mark];
      if (mark !== undefined) {
        const name = mark === 0 ? "uv" : mark < 4 ? `uv${mark}` : `texcoord_${mark}`;
        node.geometry.setAttribute("layerUv", node.geometry.getAttribute(name));
      }
      node.material = instrument(node.material, mark !== undefined);
    });
    removed.forEach((node) => node.removeFromParent());
    turned.add(gltf.scene);
    if (model) scene.remove(model);
    model = turned;
    stand = place;
    scene.add(model);
    const [x, y, z, half] = place.place;
    const size = half * 12;
    const shade = await texture(place.shadow, false);
    floor.material.map = shade;
    floor.scale.setScalar(size);
    floor.position.set(x, y - half * 1e-3, z);
    const uv = floor.geometry.getAttribute("uv"), at = floor.geometry.getAttribute("position");
    for (let k = 0; k < uv.count; k++) {
      uv.setXY(k, 0.5 + (at.getX(k) * size) / (2 * half), 0.5 - (at.getY(k) * size) / (2 * half));
    }
    uv.needsUpdate = true;
    floor.material.needsUpdate = true;
    dome.scale.setScalar(half * 40);
    dome.position.set(x, y, z);
    home();
    redraw();
  }

  const lights = new Map();
  async function showLight(number) {
    if (!lights.has(number)) {
      const { rows, cols } = state.light_size;
      const values = new Uint16Array(await bytes(`/light/${number}`));
      const made = new T.DataTexture(values, cols, rows, T.RGBAFormat, T.HalfFloatType);
      made.mapping = T.EquirectangularReflectionMapping;
      made.magFilter = made.minFilter = T.LinearFilter;
      made.needsUpdate = true;
      lights.set(number, made);
    }
    scene.environment = lights.get(number);
    brighten();
  }

  function brighten() {
    const stops = 2 ** Number(byId("stops").value), light = state.lights[Number(byId("light").value)];
    scene.environmentIntensity = stops;
    scene.environmentRotation.set(0, (Number(byId("turn").value) * Math.PI) / 180, 0);
    for (const surface of [dome, floor]) surface.material.color.setRGB(...light.floor.map((value) => value * stops));
    redraw();
  }

  // ---- painting

  const painted = new Map();
  async function layerOf(path) {
    if (!painted.has(path)) {
      const answer = await json(path);
      const made = { texels: answer.texels };
      for (const [name, uri] of Object.entries(answer.maps)) made[name] = await texture(uri, name === "base_color");
      painted.set(path, made);
      if (painted.size > 24) {
        const [oldest, { texels, ...maps }] = painted.entries().next().value;
        Object.values(maps).forEach((map) => map.dispose());
        painted.delete(oldest);
      }
    }
    return painted.get(path);
  }

  let latest = 0;
  async function paint(fine) {
    const mine = ++latest;
    if (chosen("layer") === "clean") return use(null);
    const texels = fine || state.baked ? state.texels.fine : state.texels.coarse;
    const choice = choices()[Number(byId("choice").value)];
    const seed = choice.seeds ? seedOf() : 0, amount = choice.amounts ? amountOf() : 100;
    const path = `/layer/${byId("piece").value}/${byId("choice").value}/${seed}/${amount}/${texels}`;
    const began = performance.now();
    if (!(path in stored) && !painted.has(path)) say(fine ? "Refining …" : "Painting …");
    try {
      const made = await layerOf(path);
      if (mine !== latest) return;
      use(made);
      say(`${made.texels} texels, ${((performance.now() - began) / 1000).toFixed(1)} s`, "quiet");
      canvas.dataset.painted = path;
    } catch (error) {
      if (error instanceof Superseded) return;
      if (mine === latest) say(error.message, "fault");
      return;
    }
    if (!fine && !state.baked && !sliding) paint(true);
  }

  function use(made) {
    layer.layerShare.value = made ? 1 : 0;
    if (made) {
      layer.layerColor.value = made.base_color;
      if (made.orm) layer.layerGloss.value = made.orm;
      if (made.normal) layer.layerRelief.value = made.normal;
      layer.layerHas.value.set(1, made.orm ? 1 : 0, made.normal ? 1 : 0);
    } else say("", "quiet");
    redraw();
  }

  // ---- the panel

  const chosen = (name) => document.querySelector(`input[name=${name}]:checked`).value;
  const choices = () => state.pieces[Number(byId("piece").value)].choices;
  const pick = (list, value) => (list ? list[value] : value);
  const seedOf = () => pick(state.baked && state.baked.seeds, Number(byId("seed").value));
  const amountOf = () => pick(state.baked && state.baked.amounts, Number(byId("amount").value));
  let sliding = false;

  function fill(select, entries) {
    select.replaceChildren();
    let group = null;
    entries.forEach(({ label, group: name }, index) => {
      if (name && (!group || group.label !== name)) {
        group = document.createElement("optgroup");
        group.label = name;
        select.append(group);
      }
      (name ? group : select).append(new Option(label, index));
    });
  }

  function range(id, list, least, most, value) {
    const slider = byId(id);
    [slider.min, slider.max] = list ? [0, list.length - 1] : [least, most];
    slider.value = list ? list.reduce((best, each, k) => (Math.abs(each - value) < Math.abs(list[best] - value) ? k : best), 0) : value;
  }

  function offer() {
    const { seeds, amounts } = choices()[Number(byId("choice").value)];
    byId("amount-row").hidden = !amounts;
    byId("seed-row").hidden = !seeds;
    if (amounts) range("amount", state.baked && state.baked.amounts, 100 * amounts[0], 100 * amounts[1], 100 * amounts[2]);
    label();
  }

  function label() {
    const choice = choices()[Number(byId("choice").value)];
    byId("amount-value").textContent = `${amountOf()} %`;
    byId("seed-value").textContent = seedOf();
    byId("turn-value").textContent = `${byId("turn").value}°`;
    const stops = Number(byId("stops").value);
    byId("stops-value").textContent = `${stops > 0 ? "+" : ""}${stops.toFixed(1)} stops`;
    byId("command-row").hidden = !choice.command;
    const words = [choice.command];
    if (choice.seeds) words.push(`--seed ${seedOf()}`);
    if (choice.amounts) words.push(`--amount ${amountOf() / 100}`);
    byId("command").textContent = `${words.join(" ")} -o weathered.glb`;
  }

  const state = await json("/state").catch((error) => { say(error.message, "fault"); throw error; });
  byId("title").textContent = state.title;
  fill(byId("piece"), state.pieces.map(({ name }) => ({ label: name })));
  byId("piece-row").hidden = state.pieces.length < 2;
  fill(byId("light"), state.lights.map(({ name }) => ({ label: name })));
  fill(byId("choice"), choices());
  range("seed", state.baked && state.baked.seeds, 0, state.most_seeds - 1, 0);
  offer();

  const on = (id, event, act) => byId(id).addEventListener(event, act);
  for (const id of ["amount", "seed"]) {
    on(id, "input", () => { sliding = true; label(); paint(false); });
    on(id, "change", () => { sliding = false; paint(false); });
  }
  on("choice", "change", () => { offer(); paint(false); });
  on("dice", "click", () => {
    const slider = byId("seed");
    slider.value = (Number(slider.value) + 1) % (Number(slider.max) + 1);
    label();
    paint(false);
  });
  for (const radio of document.querySelectorAll("input[name=layer]")) radio.addEventListener("change", () => paint(false));
  ["color", "gloss", "relief"].forEach((name, k) => on(`use-${name}`, "change", (event) => {
    layer.layerUse.value.setComponent(k, event.target.checked ? 1 : 0);
    redraw();
  }));
  on("look", "change", (event) => {
    layer.look.value = Number(event.target.value);
    redraw();
  });
  on("light", "change", () => showLight(Number(byId("light").value)));
  for (const id of ["turn", "stops"]) on(id, "input", () => { label(); brighten(); });
  on("home", "click", home);
  on("piece", "change", async () => {
    fill(byId("choice"), choices());
    offer();
    use(null);
    await showModel(Number(byId("piece").value)).catch((error) => say(error.message, "fault"));
    paint(false);
  });
  on("picture", "click", () => canvas.toBlob((blob) => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = "weathered.png";
    link.click();
    URL.revokeObjectURL(link.href);
  }));
  on("copy", "click", () => navigator.clipboard.writeText(byId("command").textContent));
  on("fold", "click", () => {
    const folded = byId("panel").classList.toggle("folded");
    byId("fold").textContent = folded ? "Show" : "Hide";
    byId("fold").setAttribute("aria-expanded", String(!folded));
  });
  byId("controls").addEventListener("submit", (event) => event.preventDefault());

  renderer.setAnimationLoop(() => {
    controls.update();
    if (!dirty) return;
    dirty = false;
    renderer.render(scene, camera);
    if (model) canvas.dataset.drawn = String(Number(canvas.dataset.drawn || 0) + 1);
  });
  try {
    await showLight(0);
    await showModel(0);
    await paint(false);
  } catch (error) {
    say(error.message, "fault");
  }
})();
