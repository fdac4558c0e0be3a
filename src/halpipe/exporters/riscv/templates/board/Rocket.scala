// Tiles of profile {{ profile.name }} for Chipyard. Text made by halpipe; it was elaborated by no generator: held against nothing real.
// Tile 0 manages and keeps its caches; each other one has an ITIM and a DTIM. The DMA engine is not part of this text.
package chipyard

import freechips.rocketchip.subsystem.{InSubsystem, RocketTileAttachParams, TilesLocated}
import org.chipsalliance.cde.config.Config

class WithHalpipeTiles extends Config((site, here, up) => {
  case TilesLocated(InSubsystem) => up(TilesLocated(InSubsystem), site) map {
    case tile: RocketTileAttachParams =>
      val params = tile.tileParams
      // Jobs run in user mode, which needs no virtual memory, behind seven entries of the memory protection.
      val core = params.core.copy(useUser = true, useVM = false, fpu = None, nPMPs = 8)
      val other = params.tileId - 1
      if (other < 0) tile.copy(tileParams = params.copy(core = core))
      else tile.copy(tileParams = params.copy(
        core = core,
        dcache = params.dcache.map(_.copy(nSets = {{ dtim_sets }}, nWays = 1, scratch = Some(BigInt({{ profile.dspm.base }}L) + other * {{ profile.dspm.stride | hex }}))),
        icache = params.icache.map(_.copy(nSets = {{ itim_sets }}, nWays = {{ itim_ways }}, itimAddr = Some(BigInt({{ profile.ispm.base }}L) + other * {{ profile.ispm.stride | hex }})))))
    case other => other
  }
})

class HalpipeConfig extends Config(
  new WithHalpipeTiles ++
  new chipyard.config.WithNoUART ++
  new chipyard.config.WithUART(address = BigInt({{ profile.uart }}L)) ++
  new freechips.rocketchip.subsystem.WithTimebase(BigInt({{ profile.timebase }})) ++
  new freechips.rocketchip.subsystem.WithExtMemSize(BigInt({{ profile.main.size }}L)) ++
  new freechips.rocketchip.rocket.WithNBigCores({{ profile.cores + 1 }}) ++
  new chipyard.config.AbstractConfig)
