// The search runs in a worker, which browsers refuse to a page that is opened as a file. There, a hidden frame runs it.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.body.append(frame);
      const inside = frame.contentWindow;
      this.tell = inside.postMessage.bind(inside);
      this.loaded = new Promise((done) => frame.addEventListener("load", done));
      inside.document.open();
      inside.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
      inside.importScripts = (...urls) => urls.reduce((before, each) => before.then(() => load(inside, each)), Promise.resolve());
      inside.document.write(`<script src="${url}"></script>`);
      inside.document.close();
    }

    postMessage(data) {
      this.loaded.then(() => this.tell(data, "*"));
    }
  };

  const load = (page, url) =>
    new Promise((done, failed) => {
      const script = page.document.createElement("script");
      Object.assign(script, { src: url, onload: done, onerror: failed });
      page.document.head.append(script);
    });
}
