// The packed arrays of replay_codec.py, unpacked: bytes to planes, planes to differences, differences to numbers.

async function inflate(base64) {
  const packed = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

const SIGNED = { 1: Int8Array, 2: Int16Array, 4: Int32Array };
const UNSIGNED = { 1: Uint8Array, 2: Uint16Array, 4: Uint32Array };

// Typed arrays wrap as the packed numbers do, so sums of differences come out right.
function joinPlanes(column, bytes, start, count) {
  const values = new (column.signed ? SIGNED : UNSIGNED)[column.width](count);
  for (let plane = 0; plane < column.width; plane++) {
    const at = start + plane * count;
    for (let k = 0; k < count; k++) values[k] |= bytes[at + k] << (8 * plane);
  }
  return values;
}

function sumUp(values, length) {
  for (let row = 0; row < values.length; row += length) {
    for (let k = row + 1; k < row + length; k++) values[k] += values[k - 1];
  }
}

function readColumns(about, bytes) {
  const columns = {};
  let start = 0;
  for (const column of about) {
    const count = column.shape.reduce((a, b) => a * b, 1);
    const values = joinPlanes(column, bytes, start, count);
    for (let turn = 0; turn < column.order; turn++) sumUp(values, column.shape[column.shape.length - 1]);
    columns[column.name] = { values, unit: column.unit };
    start += count * column.width;
  }
  return columns;
}
