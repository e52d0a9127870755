# fish completion of entroslip: commands, options, scenes, values of a scene
function __entroslip_values
    set -l words (commandline -opc)
    $words[1] template --reference 2>/dev/null |
        awk '/^## &/ { group = substr($2, 2) } /^\| `/ { gsub(/`/, "", $2); print group "%" $2 "=" }'
end

set -l commands run check tradeoff replay estimate whatif template
set -l of_scene '__fish_seen_subcommand_from run check tradeoff replay'
set -l of_run '__fish_seen_subcommand_from run'
set -l of_output '__fish_seen_subcommand_from run tradeoff replay estimate'
set -l of_set '__fish_seen_subcommand_from run check tradeoff replay whatif'
set -l of_quiet '__fish_seen_subcommand_from run check tradeoff replay estimate whatif'
set -l of_data '__fish_seen_subcommand_from estimate'
set -l of_replay '__fish_seen_subcommand_from replay'

complete -c entroslip -f
complete -c entroslip -n "not __fish_seen_subcommand_from $commands" -a run -d 'all that the scene asks for'
complete -c entroslip -n "not __fish_seen_subcommand_from $commands" -a check -d 'what would run, its cost'
complete -c entroslip -n "not __fish_seen_subcommand_from $commands" -a tradeoff -d 'what accuracy costs'
complete -c entroslip -n "not __fish_seen_subcommand_from $commands" -a replay -d 'one sample again'
complete -c entroslip -n "not __fish_seen_subcommand_from $commands" -a estimate -d 'measured values to a process'
complete -c entroslip -n "not __fish_seen_subcommand_from $commands" -a whatif -d 'another law of the friction'
complete -c entroslip -n "not __fish_seen_subcommand_from $commands" -a template -d 'a commented scene'
complete -c entroslip -n $of_scene -a '(__fish_complete_suffix .nml)'
complete -c entroslip -n $of_data -F
complete -c entroslip -n '__fish_seen_subcommand_from whatif' -a '(__fish_complete_suffix .h5)'
complete -c entroslip -n $of_output -l output -r -F -d 'results file'
complete -c entroslip -n $of_run -l fresh -d 'discard what an earlier run left'
complete -c entroslip -n $of_set -l set -x -a '(__entroslip_values)' -d 'override a value: group%name=value'
complete -c entroslip -n $of_quiet -l quiet -d 'no progress, no summary'
complete -c entroslip -n $of_run -l share -d 'one of several runs on one output'
complete -c entroslip -n $of_replay -l case -x -d 'case number, from 1'
complete -c entroslip -n $of_replay -l sample -x -d 'sample number, from 1'
complete -c entroslip -n '__fish_seen_subcommand_from template' -l reference -d 'the scene reference, in Markdown'
complete -c entroslip -l help -d 'one screen of help'
complete -c entroslip -l version -d 'version, compiler, flags, libraries'
