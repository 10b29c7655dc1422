// What the JavaScript decoder makes of a file, for tests/progressive.rs to compare with what `gltf-lod rebuild` writes.
//
//     node tests/progressive.mjs progressive FILE.glb TRIANGLES…    a hash of each mesh at each number of triangles
//     node tests/progressive.mjs plain FILE.glb MESH…               the same of meshes as they are
//     node tests/progressive.mjs damaged FILE.glb                   which changes of bytes are refused; no others give unsound meshes

import { createHash } from "node:crypto";
import { readFileSync } from "node:fs";
import { openProgressive } from "../js/gltf-lod-progressive.mjs";

const TYPES = { 5120: Int8Array, 5121: Uint8Array, 5122: Int16Array, 5123: Uint16Array, 5125: Uint32Array, 5126: Float32Array };
const WIDTHS = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4, MAT2: 4, MAT3: 9, MAT4: 16 };

/** Triangles as text: corners by value, the smallest first, all sorted. Triangles of one corner stand in for none. */
function hashLevel(level) {
  const lines = [];
  for (const { primitive, indices, attributes, targets } of level) {
    const byName = ([a], [b]) => (a < b ? -1 : 1);
    const columns = [attributes, ...targets].flatMap((list) => Object.entries(list ?? {}).sort(byName));
    const text = (vertex) =>
      columns.map(([, { array, itemSize }]) => Array.from(array.subarray(vertex * itemSize, (vertex + 1) * itemSize), (x) => x + 0));
    for (let at = 0; at < indices.length; at += 3) {
      const corners = [0, 1, 2].map((k) => text(indices[at + k]).join());
      if (corners[0] === corners[1] && corners[0] === corners[2]) continue;
      const first = corners.indexOf(corners.reduce((a, b) => (a < b ? a : b)));
      lines.push(`${primitive} ${[0, 1, 2].map((k) => corners[(first + k) % 3]).join(" ")}`);
    }
  }
  return `${lines.length} ${createHash("sha256").update(lines.sort().join("\n")).digest("hex")}`;
}

/** The triangles of a plain GLB's mesh, read without the decoder. */
function readPlain(bytes, mesh) {
  const length = bytes.readUInt32LE(12);
  const json = JSON.parse(bytes.subarray(20, 20 + length));
  const bin = bytes.subarray(28 + length);
  const read = (index) => {
    const { type, componentType, count, byteOffset = 0, bufferView } = json.accessors[index];
    const [Type, itemSize, view] = [TYPES[componentType], WIDTHS[type], json.bufferViews[bufferView]];
    const stride = view.byteStride ?? Type.BYTES_PER_ELEMENT * itemSize;
    const array = new Type(count * itemSize);
    for (let i = 0; i < count; i += 1) {
      const start = (view.byteOffset ?? 0) + byteOffset + i * stride;
      const element = Uint8Array.from(bin.subarray(start, start + itemSize * Type.BYTES_PER_ELEMENT));
      array.set(new Type(element.buffer), i * itemSize);
    }
    return { array, itemSize };
  };
  const readAll = (list) => Object.fromEntries(Object.entries(list).map(([name, index]) => [name, read(index)]));
  const triangles = json.meshes[mesh].primitives.map((primitive, number) => ({ primitive, number }));
  return triangles
    .filter(({ primitive }) => (primitive.mode ?? 4) === 4)
    .map(({ primitive, number }) => ({
      primitive: number,
      indices: read(primitive.indices).array,
      attributes: readAll(primitive.attributes),
      targets: (primitive.targets ?? []).map(readAll),
    }));
}

/** Changes bytes all over the file, one at a time; what is accepted must be sound. */
function damage(bytes) {
  const { json, bin } = openProgressive(bytes);
  const chunks = json.meshes.flatMap((mesh) => Object.values(mesh.extensions ?? {}).flatMap((e) => e.chunks ?? []));
  const records = bin.byteOffset - bytes.byteOffset + Math.min(...chunks.map((c) => json.bufferViews[c.bufferView].byteOffset));
  const isRefused = (source, at) => {
    const copy = Uint8Array.from(source);
    copy[at] ^= 1 + (at % 255);
    try {
      for (const mesh of openProgressive(copy).meshes) {
        mesh.refine();
        for (const { indices, attributes } of mesh.level()) {
          const { array, itemSize } = attributes.POSITION;
          if (indices.some((index) => index >= array.length / itemSize)) throw new RangeError("an index without a vertex");
        }
      }
      return false;
    } catch (error) {
      if (error instanceof TypeError || error instanceof RangeError) throw error;
      return true;
    }
  };
  const count = (source, from, to, step) => {
    let [refused, tried] = [0, 0];
    for (let at = from; at < to; at += step) [refused, tried] = [refused + isRefused(source, at), tried + 1];
    return refused === 0 ? "none" : refused === tried ? "all" : "some";
  };
  // The same file without checksums: what they keep from the decoder.
  const unchecked = Uint8Array.from(bytes);
  const text = Buffer.from(unchecked.buffer);
  for (let at = text.indexOf('"crc32"'); at >= 0; at = text.indexOf('"crc32"')) text.write('"crc33"', at);
  return [
    `records: ${count(bytes, records, bytes.length, 97)}`,
    `without checksums: ${count(unchecked, records, bytes.length, 97)}`,
    `before them: ${count(unchecked, 0, records, 23)}`,
  ];
}

const [mode, file, ...numbers] = process.argv.slice(2);
const bytes = readFileSync(file);
if (mode === "plain") {
  for (const mesh of numbers) console.log(hashLevel(readPlain(bytes, Number(mesh))));
} else if (mode === "damaged") {
  console.log(damage(bytes).join("\n"));
} else {
  const { meshes } = openProgressive(bytes);
  for (const triangles of numbers.map(Number)) {
    for (const mesh of meshes) {
      mesh.refine(triangles);
      console.log(hashLevel(mesh.level()));
    }
  }
}
