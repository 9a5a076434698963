/* A browser gives a page that was opened from a folder no Worker: the search then runs in a hidden frame of the page. */
if (location.protocol === "file:")
  window.Worker = window.IFrameWorker = class extends EventTarget {
    constructor(address) {
      super()
      this.frame = document.createElement("iframe")
      this.frame.hidden = true
      document.body.append(this.frame)
      const inside = this.frame.contentWindow
      inside.postMessage = data => this.dispatchEvent(new MessageEvent("message", {data}))
      this.ready = this.load(address)
      inside.importScripts = (...addresses) => Promise.all(addresses.map(script => this.load(script)))
    }

    load(address) {
      const script = this.frame.contentDocument.createElement("script")
      script.src = address
      const done = new Promise((resolve, reject) => Object.assign(script, {onload: resolve, onerror: reject}))
      this.frame.contentDocument.head.append(script)
      return done
    }

    postMessage(data) {
      this.ready.then(() => this.frame.contentWindow.dispatchEvent(new MessageEvent("message", {data})))
    }

    terminate() {
      this.frame.remove()
    }
  }
