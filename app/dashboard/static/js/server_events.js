/** Server-sent events, read from a response: unlike EventSource this can send headers and knows of problems. */

/** @typedef {{kind: string, data: any, id: string | null}} ServerEvent */

/**
 * Yield the events of a body as they come.
 * @param {ReadableStream<Uint8Array>} body
 * @returns {AsyncGenerator<ServerEvent>}
 */
export async function* eventsOf(body) {
  const reader = body.getReader();
  const decoder = new TextDecoder();
  let rest = '';
  try {
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return;
      rest += decoder.decode(value, { stream: true });
      const blocks = rest.split(/\r?\n\r?\n/);
      rest = blocks.pop() || '';
      for (const block of blocks) {
        const event = read(block);
        if (event) yield event;
      }
    }
  } finally {
    reader.cancel().catch(() => {});
  }
}

/**
 * Return the event that a block of lines tells, null for a comment.
 * @param {string} block
 * @returns {ServerEvent | null}
 */
function read(block) {
  const event = { kind: 'message', id: /** @type {string | null} */ (null) };
  const data = [];
  for (const line of block.split(/\r?\n/)) {
    const [, name, value] = /^([^:]*):? ?(.*)$/.exec(line) || [];
    if (name === 'event') event.kind = value;
    else if (name === 'id') event.id = value;
    else if (name === 'data') data.push(value);
  }
  return data.length ? { ...event, data: JSON.parse(data.join('\n')) } : null;
}
