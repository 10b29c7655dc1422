// Progressive meshes (GLTFLOD_mesh_progressive) in a browser or in node: any resolution of a GLB's meshes, from as many of its bytes as there are.
//
//     import { openProgressive } from "./gltf-lod-progressive.mjs";
//
//     const file = openProgressive(bytes);            // an ArrayBuffer or Uint8Array: the file, or its beginning
//     const [mesh] = file.meshes;
//     mesh.refine(5000);                              // to at most 5000 triangles, or as far as the bytes go
//     for (const { primitive, indices, attributes, targets } of mesh.level()) { … }
//     file.extend(moreBytes);                         // a longer beginning of the same file: go on with refine
//
// Vertices and triangles come as typed arrays in the component types of the file. docs/GLTFLOD_mesh_progressive.md has the format.

export const EXTENSION = "GLTFLOD_mesh_progressive";

const POSITION = 3; // numbers of a row that are the position
const FARTHEST = 8192; // corners at a vertex among which a neighbour may be named
const INTEGER = 1000; // in place of a step: the number is an integer
const EXACT = 1001; // in place of a step: every bit of the float counts

const COMPONENTS = {
  5120: Int8Array,
  5121: Uint8Array,
  5122: Int16Array,
  5123: Uint16Array,
  5125: Uint32Array,
  5126: Float32Array,
};
const WIDTHS = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4, MAT2: 4, MAT3: 9, MAT4: 16 };

/** Opens a GLB or as much of its beginning as there is; it must reach up to the first records. */
export function openProgressive(bytes) {
  return guarded(() => new ProgressiveFile(bytes));
}

/** What `read` gives. Where something that should be in the document is not, or is of another kind, the error says so. */
function guarded(read) {
  try {
    return read();
  } catch (error) {
    if (error instanceof TypeError || error instanceof RangeError) throw new Error(`the file is damaged: ${error.message}`);
    throw error;
  }
}

export class ProgressiveFile {
  constructor(bytes) {
    this.extend(bytes);
    const { json } = this;
    this.meshes = (json.meshes ?? []).flatMap((mesh, index) =>
      mesh.extensions?.[EXTENSION] ? [new ProgressiveMesh(this, index)] : [],
    );
  }

  /** Takes a longer beginning of the same file. */
  extend(bytes) {
    const { json, bin, complete } = readGlb(bytes);
    this.json ??= json;
    this.bin = bin;
    this.complete = complete;
  }

  /** What there is of a buffer view. */
  view(index) {
    const view = this.json.bufferViews[index];
    const start = view.byteOffset ?? 0;
    return this.bin.subarray(start, start + view.byteLength);
  }
}

function readGlb(source) {
  const bytes = source instanceof Uint8Array ? source : new Uint8Array(source);
  const data = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  if (bytes.length < 20 || data.getUint32(0, true) !== 0x46546c67) throw new Error("not a GLB, or less than its header");
  const total = data.getUint32(8, true);
  let [json, bin] = [undefined, new Uint8Array()];
  for (let at = 12; at + 8 <= Math.min(total, bytes.length); ) {
    const [length, kind] = [data.getUint32(at, true), data.getUint32(at + 4, true)];
    const chunk = bytes.subarray(at + 8, at + 8 + length);
    if (kind === 0x4e4f534a && chunk.length === length) json ??= JSON.parse(new TextDecoder().decode(chunk));
    if (kind === 0x004e4942) bin = chunk;
    at += 8 + length;
  }
  if (!json) throw new Error("the file ends before its JSON does");
  return { json, bin, complete: bytes.length >= total };
}

/** A mesh that starts as its base and is refined by its records. */
export class ProgressiveMesh {
  constructor(file, index) {
    this.file = file;
    this.mesh = index;
    this.extension = file.json.meshes[index].extensions[EXTENSION];
    if (this.extension.version !== 1) throw new Error(`version ${this.extension.version} of ${EXTENSION} is not known`);
    this.place = `/meshes/${index}/extensions/${EXTENSION}`;
    this.fullTriangles = this.extension.triangles;
    this.groups = this.extension.primitives.map((group) => this.#openGroup(group));
    this.state = new State(this.groups.map((group) => group.numbers));
    this.groups.forEach((group, number) => this.#readBase(group, number));
    this.next = { chunk: 0, at: 0, records: 0 };
    this.checked = 0; // chunks whose checksums are right
  }

  /** Triangles now. */
  get triangles() {
    return this.state.faceCount;
  }

  /**
   * Applies records for as long as there are no more than `triangles` triangles. Gives "target", "end" when the mesh is full, or "bytes" when
   * more of the file is needed.
   */
  refine(triangles = Infinity) {
    return guarded(() => this.#refine(triangles));
  }

  #refine(triangles) {
    const { chunks } = this.extension;
    while (this.next.chunk < chunks.length) {
      const chunk = chunks[this.next.chunk];
      const bytes = this.file.view(chunk.bufferView);
      this.#check(chunk, bytes);
      while (this.next.records < chunk.records) {
        const reader = new Reader(bytes, this.next.at);
        let record;
        try {
          record = readRecord(this.state, reader);
        } catch (error) {
          if (error === TRUNCATED && !this.file.complete) return "bytes";
          const what = error === TRUNCATED ? "the bytes end inside it" : error.message;
          throw new Error(`${this.place}/chunks/${this.next.chunk}: record ${this.next.records}: ${what}`);
        }
        if (this.state.faceCount + record.faces.length / 3 > triangles) return "target";
        this.state.apply(record);
        this.next.at = reader.at;
        this.next.records += 1;
      }
      if (this.next.at !== this.file.json.bufferViews[chunk.bufferView].byteLength) {
        throw new Error(`${this.place}/chunks/${this.next.chunk}: bytes are left after ${chunk.records} records`);
      }
      this.next = { chunk: this.next.chunk + 1, at: 0, records: 0 };
    }
    return "end";
  }

  /** A chunk that is all there must have its checksum. */
  #check({ bufferView, crc32 }, bytes) {
    if (this.checked > this.next.chunk || crc32 === undefined) return;
    if (bytes.length < this.file.json.bufferViews[bufferView].byteLength) return;
    if (checksum(bytes) !== crc32) {
      throw new Error(`${this.place}/chunks/${this.next.chunk}: the checksum of the records is another one`);
    }
    this.checked = this.next.chunk + 1;
  }

  /**
   * The primitives that have triangles now: `{ primitive, indices, attributes, targets }` with `attributes` (and each of `targets`) by name
   * `{ array, itemSize, normalized }`.
   */
  level() {
    return guarded(() => this.#level());
  }

  #level() {
    const { state } = this;
    const vertices = this.groups.map(() => []);
    const local = new Uint32Array(state.vertexCount);
    for (let vertex = 0; vertex < state.vertexCount; vertex += 1) {
      local[vertex] = vertices[state.groups[vertex]].push(vertex) - 1;
    }
    const corners = this.groups.map(() => []);
    for (let face = 0; face < state.faceCount; face += 1) {
      const list = corners[state.groups[state.corners[3 * face]]];
      for (let k = 0; k < 3; k += 1) list.push(local[state.corners[3 * face + k]]);
    }
    return this.groups.flatMap((group, number) =>
      corners[number].length > 0 ? [this.#describe(group, vertices[number], corners[number])] : [],
    );
  }

  #describe(group, vertices, corners) {
    const level = { primitive: group.primitive, indices: new Uint32Array(corners), attributes: {}, targets: [] };
    for (const channel of group.channels) {
      const { name, target, width, component, normalized, offset } = channel;
      const array = new COMPONENTS[component](vertices.length * width);
      const raw = component === 5126 ? new Int32Array(array.buffer) : array;
      vertices.forEach((vertex, i) => {
        const start = this.state.starts[vertex] + offset;
        for (let k = 0; k < width; k += 1) raw[i * width + k] = this.state.numbers[start + k];
      });
      const list = target === null ? level.attributes : (level.targets[target] ??= {});
      list[name] = { array, itemSize: width, normalized };
    }
    return level;
  }

  /** What a row of the primitive's vertices is made of. */
  #openGroup(group) {
    const { json } = this.file;
    const primitive = json.meshes[this.mesh].primitives[group.primitive];
    const channels = [];
    const numbers = [];
    const open = (target, attributes, listed) => {
      for (const { name, step } of listed) {
        const accessor = json.accessors[attributes[name]];
        if (!accessor) throw new Error(`${this.place}: ${name} is listed, but the primitive has no such attribute`);
        const [width, component] = [WIDTHS[accessor.type], accessor.componentType];
        channels.push({ name, target, width, component, normalized: accessor.normalized === true, offset: numbers.length, accessor });
        const kind = component !== 5126 ? INTEGER : step ?? EXACT;
        for (let k = 0; k < width; k += 1) numbers.push(kind);
      }
    };
    open(null, primitive.attributes, group.attributes);
    (group.targets ?? []).forEach((listed, target) => open(target, primitive.targets[target], listed));
    return { primitive: group.primitive, empty: group.empty === true, channels, numbers, indices: json.accessors[primitive.indices] };
  }

  #readBase(group, number) {
    if (group.empty) return;
    const first = this.state.vertexCount;
    const columns = group.channels.map(({ accessor }) => this.#readAccessor(accessor));
    const row = new Int32Array(group.numbers.length);
    for (let vertex = 0; vertex < group.channels[0].accessor.count; vertex += 1) {
      group.channels.forEach(({ width, offset }, c) => {
        for (let k = 0; k < width; k += 1) row[offset + k] = columns[c][vertex * width + k];
      });
      this.state.addVertex(number, row, 0);
    }
    const corners = this.#readAccessor(group.indices);
    for (let at = 0; at < corners.length; at += 3) {
      this.state.addFace(first + corners[at], first + corners[at + 1], first + corners[at + 2]);
    }
  }

  /** The stored numbers of an accessor; floats as their bits. */
  #readAccessor(accessor) {
    const [width, Type] = [WIDTHS[accessor.type], COMPONENTS[accessor.componentType]];
    if (accessor.sparse || (accessor.type.startsWith("MAT") && Type.BYTES_PER_ELEMENT < 4)) {
      throw new Error("sparse accessors and matrices of small integers are not read");
    }
    const bytes = this.file.view(accessor.bufferView);
    const size = width * Type.BYTES_PER_ELEMENT;
    const stride = this.file.json.bufferViews[accessor.bufferView].byteStride ?? size;
    const end = (accessor.byteOffset ?? 0) + (accessor.count - 1) * stride + size;
    if (!(end <= bytes.length && accessor.count >= 1 && stride >= size)) {
      throw new Error(`${this.place}: an accessor of the base is not all there`);
    }
    const data = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    const read = {
      5120: (at) => data.getInt8(at),
      5121: (at) => data.getUint8(at),
      5122: (at) => data.getInt16(at, true),
      5123: (at) => data.getUint16(at, true),
      5125: (at) => data.getUint32(at, true),
      5126: (at) => data.getInt32(at, true),
    }[accessor.componentType];
    const numbers = new Int32Array(accessor.count * width);
    for (let element = 0; element < accessor.count; element += 1) {
      const start = (accessor.byteOffset ?? 0) + element * stride;
      for (let k = 0; k < width; k += 1) numbers[element * width + k] = read(start + k * Type.BYTES_PER_ELEMENT);
    }
    return numbers;
  }
}

// --- numbers ---

const FLOAT = new Float32Array(1);
const BITS = new Int32Array(FLOAT.buffer);

function valueOf(raw) {
  BITS[0] = raw;
  return FLOAT[0];
}

function rawOf(value) {
  FLOAT[0] = value;
  return BITS[0];
}

/** Bits of a float as an integer that grows with the float; its own inverse. */
const ordered = (raw) => (raw < 0 ? raw ^ 0x7fffffff : raw);

function gridIndex(raw, step) {
  const index = Math.floor(valueOf(raw) / 2 ** step + 0.5);
  return Math.max(-2147483648, Math.min(2147483647, index));
}

function restore(number, exact, predicted, residual) {
  if (number === INTEGER) return (predicted + residual) | 0;
  const raw =
    exact || number === EXACT
      ? ordered((ordered(predicted) + residual) | 0)
      : rawOf(((gridIndex(predicted, number) + residual) | 0) * 2 ** number);
  if (!Number.isFinite(valueOf(raw))) throw new Error("a number that is not finite");
  return raw;
}

/** What is expected at the second end of a split: as far from the joined value as the first end, on the other side. */
function mirror(number, joined, first) {
  if (number === INTEGER) return (2 * joined - first) | 0;
  const raw = rawOf(2 * valueOf(joined) - valueOf(first));
  return Number.isFinite(valueOf(raw)) ? raw : joined;
}

// --- bytes ---

const CHECKSUMS = Uint32Array.from({ length: 256 }, (_, byte) => {
  for (let bit = 0; bit < 8; bit += 1) byte = byte & 1 ? 0xedb88320 ^ (byte >>> 1) : byte >>> 1;
  return byte;
});

/** CRC-32. */
function checksum(bytes) {
  let sum = -1;
  for (let at = 0; at < bytes.length; at += 1) sum = CHECKSUMS[(sum ^ bytes[at]) & 255] ^ (sum >>> 8);
  return ~sum >>> 0;
}

const TRUNCATED = new Error("truncated");

class Reader {
  constructor(bytes, at) {
    this.bytes = bytes;
    this.at = at;
    this.zeros = 0;
  }

  byte() {
    if (this.at >= this.bytes.length) throw TRUNCATED;
    return this.bytes[this.at++];
  }

  unsigned() {
    let value = 0;
    for (let shift = 0; shift < 35; shift += 7) {
      const byte = this.byte();
      if (shift === 28 && (byte & 0x7f) > 0xf) break;
      value += (byte & 0x7f) * 2 ** shift;
      if (byte < 0x80) return value;
    }
    throw new Error("an integer of more than 32 bits");
  }

  /** A difference; a 0 is followed by how many more there are. */
  residual() {
    if (this.zeros > 0) {
      this.zeros -= 1;
      return 0;
    }
    const value = this.unsigned();
    if (value === 0) this.zeros = this.unsigned();
    return (value >>> 1) ^ -(value & 1);
  }

  endResiduals() {
    if (this.zeros > 0) throw new Error("more zeros than there are numbers");
  }
}

// --- the mesh ---

/** Doubles what is too short. */
function grown(array, length) {
  if (array.length >= length) return array;
  const longer = new array.constructor(Math.max(2 * array.length, length));
  longer.set(array);
  return longer;
}

class State {
  constructor(layouts) {
    this.layouts = layouts;
    this.vertexCount = 0;
    this.groups = new Uint32Array(64);
    this.starts = new Float64Array(64);
    this.numbers = new Int32Array(1024);
    this.numberCount = 0;
    this.faceCount = 0;
    this.corners = new Uint32Array(192);
    this.rings = [];
  }

  layout(vertex) {
    return this.layouts[this.groups[vertex]];
  }

  addVertex(group, rows, at) {
    const width = this.layouts[group].length;
    this.groups = grown(this.groups, this.vertexCount + 1);
    this.starts = grown(this.starts, this.vertexCount + 1);
    this.numbers = grown(this.numbers, this.numberCount + width);
    this.groups[this.vertexCount] = group;
    this.starts[this.vertexCount] = this.numberCount;
    for (let i = 0; i < width; i += 1) this.numbers[this.numberCount + i] = rows[at + i];
    this.numberCount += width;
    this.rings.push([]);
    return this.vertexCount++;
  }

  addFace(a, b, c) {
    if (Math.max(a, b, c) >= this.vertexCount) throw new Error("a vertex that is not there");
    this.corners = grown(this.corners, 3 * this.faceCount + 3);
    this.corners.set([a, b, c], 3 * this.faceCount);
    for (const vertex of [a, b, c]) this.rings[vertex].push(this.faceCount);
    this.faceCount += 1;
  }

  cornerOf(face, vertex) {
    for (let k = 0; k < 3; k += 1) if (this.corners[3 * face + k] === vertex) return k;
    return -1;
  }

  neighbour(vertex, number) {
    const face = this.rings[vertex][number >> 1];
    const corner = face === undefined ? -1 : this.cornerOf(face, vertex);
    if (corner < 0) throw new Error("a face at a neighbour that is not there");
    return this.corners[3 * face + ((corner + 1 + (number & 1)) % 3)];
  }

  apply(record) {
    let at = 0;
    for (const { vertex, ends, owners } of record.splits) {
      const group = this.groups[vertex];
      const width = this.layouts[group].length;
      const ids = ends.map((_, child) => {
        const start = at;
        at += width;
        if (child > 0) return this.addVertex(group, record.rows, start);
        for (let i = 0; i < width; i += 1) this.numbers[this.starts[vertex] + i] = record.rows[start + i];
        return vertex;
      });
      if (ends.length > 1) this.#handOver(vertex, ids, owners);
    }
    for (const group of record.added) {
      this.addVertex(group, record.rows, at);
      at += this.layouts[group].length;
    }
    for (let f = 0; f < record.faces.length; f += 3) {
      this.addFace(record.faces[f], record.faces[f + 1], record.faces[f + 2]);
    }
  }

  #handOver(vertex, ids, owners) {
    const ring = this.rings[vertex];
    if (ring.length !== owners.length) throw new Error("a vertex is split twice");
    this.rings[vertex] = [];
    ring.forEach((face, i) => {
      const corner = this.cornerOf(face, vertex);
      if (corner >= 0) this.corners[3 * face + corner] = ids[owners[i]];
      this.rings[ids[owners[i]]].push(face);
    });
  }
}

// --- records ---

function readRecord(state, reader) {
  const flags = reader.byte();
  if (flags & 128) throw new Error("a flag that is not known");
  const faceCount = (flags & 3) === 3 ? 3 + reader.unsigned() : flags & 3;
  const splitCount = flags & 4 ? reader.unsigned() : 1;
  const addedCount = flags & 8 ? reader.unsigned() : 0;
  const record = { exact: [(flags & 16) > 0, (flags & 32) > 0], splits: [], added: [], rows: [], faces: [] };
  for (let i = 0; i < splitCount; i += 1) record.splits.push(readSplit(state, i > 0 || (flags & 64) > 0, reader));
  const made = readChildren(state, record, reader);
  for (let i = 0; i < addedCount; i += 1) readAdded(state, record, made, reader);
  for (let i = 0; i < faceCount; i += 1) readFace(state, record, made, reader);
  return record;
}

function readSplit(state, withShape, reader) {
  const vertex = state.vertexCount - 1 - reader.unsigned();
  if (vertex < 0) throw new Error("a split of a vertex that is not there");
  const shape = withShape ? reader.unsigned() : 2;
  const ends = shape < 2 ? [shape] : shape === 2 ? [0, 1] : [];
  for (let i = 1; shape > 2 && i < shape; i += 1) {
    ends.push(reader.byte());
    if (ends.at(-1) > 1) throw new Error("a child at neither end of its split");
  }
  const owners = [];
  const bits = 32 - Math.clz32(ends.length - 1);
  let [word, filled] = [0, 0];
  for (let i = 0; ends.length > 1 && i < state.rings[vertex].length; i += 1) {
    while (filled < bits) {
      word += reader.byte() * 2 ** filled;
      filled += 8;
    }
    const owner = word % 2 ** bits;
    if (owner >= ends.length) throw new Error("a corner for a child that is not there");
    owners.push(owner);
    word = Math.floor(word / 2 ** bits);
    filled -= bits;
  }
  return { vertex, ends, owners };
}

/** The vertices that the splits make: `{ id, group, start }`, `start` being where the row is in the record's rows. */
function readChildren(state, record, reader) {
  const { rows } = record;
  const made = [];
  const first = [undefined, undefined];
  let next = state.vertexCount;
  for (const split of record.splits) {
    const { vertex } = split;
    const layout = state.layout(vertex);
    let sibling;
    split.made = made.length;
    split.ends.forEach((end, child) => {
      const start = rows.length;
      for (let i = 0; i < layout.length; i += 1) {
        if (i < POSITION && first[end] !== undefined) {
          rows.push(rows[first[end] + i]);
          continue;
        }
        const joined = state.numbers[state.starts[vertex] + i];
        const other = i < POSITION ? first[0] : sibling;
        const predicted = end === 1 && other !== undefined ? mirror(layout[i], joined, rows[other + i]) : joined;
        rows.push(restore(layout[i], record.exact[end], predicted, reader.residual()));
      }
      first[end] ??= start;
      if (end === 0) sibling ??= start;
      made.push({ id: child === 0 ? vertex : next++, group: state.groups[vertex], start });
    });
  }
  reader.endResiduals();
  return made;
}

function readAdded(state, record, made, reader) {
  const predictor = readReference(state, made, reader);
  const named = reader.unsigned();
  const group = named < 2 ? predictor.group : Math.floor(named / 2) - 1;
  const layout = state.layouts[group];
  if (!layout) throw new Error("a vertex of a primitive that is not there");
  const [from, at] =
    predictor.start === undefined ? [state.numbers, state.starts[predictor.id]] : [record.rows, predictor.start];
  const start = record.rows.length;
  layout.forEach((number, i) => {
    const predicted = group === predictor.group || i < POSITION ? from[at + i] : 0;
    record.rows.push(restore(number, named % 2 === 1, predicted, reader.residual()));
  });
  reader.endResiduals();
  record.added.push(group);
  const children = made.length - (record.added.length - 1);
  const newChildren = children - record.splits.length;
  made.push({ id: state.vertexCount + newChildren + record.added.length - 1, group, start });
}

/** A vertex that the record has made, or one from before it. */
function readReference(state, made, reader) {
  const number = reader.unsigned();
  if (number < made.length) return made[number];
  const id = number - made.length;
  if (id >= state.vertexCount) throw new Error("a vertex that is not there");
  return { id, group: state.groups[id], start: undefined };
}

function readFace(state, record, made, reader) {
  let code = reader.unsigned();
  let corners;
  if (code === 0) {
    corners = [0, 0, 0].map(() => readReference(state, made, reader));
  } else {
    code -= 1;
    const turned = code % 2;
    const count = record.splits.length;
    const number = count === 0 ? FARTHEST : Math.floor(Math.floor(code / 2) / count);
    if (number >= FARTHEST) throw new Error("a face at a neighbour that is not there");
    const split = record.splits[Math.floor(code / 2) % count];
    const id = state.neighbour(split.vertex, number);
    if (split.ends.length !== 2) throw new Error("a face between children that are not two");
    const pair = [made[split.made], made[split.made + 1]];
    corners = [pair[turned], pair[1 - turned], { id, group: state.groups[id] }];
  }
  if (corners.some(({ group }) => group !== corners[0].group)) {
    throw new Error("a face over vertices of several primitives");
  }
  record.faces.push(...corners.map(({ id }) => id));
}
